"""A recording with a quaternion that is no rotation is refused by every command that reads it, in one sentence."""

import pytest

from surefoot.lab.report.traces import traces_of
from surefoot.record.recording import RecordingWriter, read_recording, recording_info
from surefoot.schemas.topics import SIM_TRUTH, STATE_ODOMETRY, TOPICS

pytestmark = pytest.mark.usefixtures("apart")
GOOD = 100
ROWS = {row.key: row for row in TOPICS}


@pytest.fixture
def turned(request, recorded, tmp_path):
    """The recorded walk with zeros for a quaternion of its second half, and the key of that."""
    path, seen = tmp_path / "turned.mcap", 0
    writer = RecordingWriter(path, {"robot": "ragno"})
    for item in read_recording(recorded):
        raw = item.raw()
        if item.key == request.param:
            seen += 1
            head, _, rest = raw.payload.partition(b'"quat_wxyz":[')
            if seen > GOOD:
                raw = raw._replace(payload=head + b'"quat_wxyz":[0.0,0.0,0.0,0.0]' + rest.partition(b"]")[2])
        if item.key in ROWS:
            writer.write(ROWS[item.key], item.message(), raw)
    writer.close({})
    return path, request.param


REFUSED = "quat_wxyz: a quaternion of length 0, allowed is 1 within 0.01 (got [0.0, 0.0, 0.0, 0.0])"


@pytest.mark.parametrize(
    ("turned", "words"),
    [
        (STATE_ODOMETRY.key, "estimate"),
        (STATE_ODOMETRY.key, "bag export --to tum"),
        (SIM_TRUTH.key, "estimate"),
        (SIM_TRUTH.key, "bag export --to foxglove"),
    ],
    indirect=["turned"],
)
def test_a_quaternion_of_zero_is_refused(complaint, turned, words):
    assert complaint(*words.split(), turned[0]).splitlines()[-1].endswith(REFUSED)


@pytest.mark.parametrize("turned", [STATE_ODOMETRY.key, SIM_TRUTH.key], indirect=True)
def test_a_report_states_how_many_there_are(turned):
    path, key = turned
    count = recording_info(path)["topics"][key] - GOOD
    (shown,) = [mark.text for mark in traces_of(path).events if key in mark.text]
    assert shown.startswith(f"{count} of {key} could not be read: ")
    assert shown.endswith(REFUSED)
