"""Lines of `surefoot topic echo`, and what `surefoot topic pub` refuses before anything is sent."""

import pytest

from surefoot.lab.cli.main import main
from surefoot.lab.cli.topic import readable
from surefoot.schemas.hw import FootContacts
from surefoot.schemas.status import SimStatus
from surefoot.simtime import pace


def test_a_message_is_one_readable_line() -> None:
    message = FootContacts(touch=((True,), (False,)), normal_force_n=(1.23456, None)).stamped(
        1_230_000_000, 123, 1, 7, "x"
    )
    assert readable(message) == "t=1.230 s, tick 123: touch=[[yes] [no]], normal_force_n=[1.235 -]"
    assert readable(message, {"touch"}) == "t=1.230 s, tick 123: touch=[[yes] [no]]"


@pytest.mark.parametrize(
    ("words", "part"),
    [(("cmd/estop", '{"reson": "x"}'), "reson"), (("cmd/estop", "{"), "cmd/estop"), (("cmd/estp",), "cmd/estop")],
)
def test_a_wrong_message_is_refused_by_name(
    words: tuple[str, ...], part: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["topic", "pub", *words, "--connect", "tcp/127.0.0.1:9"])
    assert ended.value.code == 2
    shown = capsys.readouterr().err
    assert part in shown
    assert "Traceback" not in shown


def test_a_rate_that_was_not_measured_yet_is_not_stated() -> None:
    status = SimStatus(state="running", rtf=0.0, ticks=3, comparable=True).stamped(0, 3, 1, 0, "x")
    assert pace(status) == "simulated time runs: tick 3"
    assert "at 0.98 times real time, tick 3" in pace(status.model_copy(update={"rtf": 0.98}))
