"""The public list of hashes: twenty runs, each scenario, and what `surefoot verify` reports of them."""

import os
import re
import subprocess
import sys

import pytest

from surefoot.lab.again import public
from surefoot.lab.again.public import PublicRun, public_runs
from surefoot.lab.cli.main import main
from surefoot.services.supervisor.scenarios.scenario import find_scenario, load_scenario
from surefoot.version import numbers

SHORT = "stand"


def surefoot(*words: str) -> int:
    with pytest.raises(SystemExit) as end:
        main([*words])
    assert isinstance(end.value.code, int)
    return end.value.code


def test_it_has_twenty_runs_and_every_scenario_once_at_least() -> None:
    rows = public_runs()
    assert len({(row.scenario, row.seed) for row in rows}) == len(rows) == 20
    assert {row.scenario for row in rows} == {path.stem for path in find_scenario(SHORT).parent.glob("*.toml")}
    for row in rows:
        assert re.fullmatch("[0-9a-f]{64}", row.run_hash)
        assert 0 < row.ticks <= load_scenario(row.scenario).max_ticks
    assert len({row.run_hash for row in rows}) == 20


def test_a_run_of_the_list_has_its_hash_here(capsys: pytest.CaptureFixture[str]) -> None:
    assert surefoot("verify", "--scenario", SHORT) == 0
    out = capsys.readouterr().out
    assert SHORT in out
    assert "1 of 1 runs have the public hash" in out


def test_another_hash_is_named_and_ends_with_1(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = public_runs()
    monkeypatch.setattr(
        PublicRun, "again", lambda row: row._replace(run_hash="0" * 64) if row.scenario == SHORT else row
    )
    assert surefoot("verify") == 1
    out = capsys.readouterr().out
    assert "19 of 20 runs have the public hash" in out
    assert out.count("0" * 12) == 1
    assert public.LIST.is_file()
    assert rows == public_runs()


@pytest.mark.skipif(numbers() != public.NUMBERS, reason=f"the hashes are of {public.NUMBERS}, this is {numbers()}")
def test_where_the_c_library_has_other_functions_the_list_states_it() -> None:
    """Without fused multiply-add the library chooses others, as on a processor that has none."""
    words = [sys.executable, "-m", "surefoot.lab.cli.entry", "verify", "--scenario", SHORT]
    environment = os.environ | {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-AVX2"}
    done = subprocess.run(words, env=environment, capture_output=True, text=True, check=False)
    assert f"the hashes are of {public.NUMBERS}; this is x86_64, functions " in done.stdout
    assert (done.returncode == 0) == ("1 of 1 runs have the public hash" in done.stdout)


@pytest.mark.parametrize(
    ("words", "code", "text"),
    [
        (["verify", "--scenario", "stnad"], 2, "did you mean"),
        (["verify", "run.mcap", "--scenario", SHORT], 2, "--scenario"),
        (["verify", "--out", "x.mcap"], 2, "--out"),
    ],
)
def test_wrong_use_is_refused(words: list[str], code: int, text: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert surefoot(*words) == code
    assert text in capsys.readouterr().err
