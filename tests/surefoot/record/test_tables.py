"""Logs of other programs: what is read, and errors that name what is wrong."""

import numpy as np
import pytest

from surefoot.errors import SurefootError
from surefoot.record.tables import LATEST_S, read_table

N = 60
HEADER = "t,gyro_x,gyro_y,gyro_z,acc_x,acc_y,acc_z"


def rows(n: int = N) -> list[str]:
    return [f"{0.01 * k:.2f},0.001,0.002,{0.001 * k},0,0,9.81" for k in range(n)]


@pytest.fixture
def csv(tmp_path):
    def write(lines: list[str], header: str = HEADER):
        path = tmp_path / "log.csv"
        path.write_text("\n".join([header, *lines]) + "\n")
        return path

    return write


@pytest.fixture
def npz(tmp_path):
    def write(**changes):
        columns = {"t": 0.01 * np.arange(N), "gyro": np.zeros((N, 3)), "acc": np.tile([0.0, 0.0, 9.81], (N, 1))}
        columns |= {"foot_position": np.zeros((N, 2, 3)), "contact": np.ones((N, 2))}
        path = tmp_path / "log.npz"
        np.savez(path, **{key: value for key, value in (columns | changes).items() if value is not None})
        return path

    return write


def refused(path) -> SurefootError:
    with pytest.raises(SurefootError) as found:
        read_table(path)
    return found.value


def test_a_csv_becomes_columns(csv):
    columns = read_table(csv(rows()))
    assert columns["gyro"].shape == columns["acc"].shape == (N, 3)
    np.testing.assert_array_equal(columns["stamp_ns"], 10_000_000 * np.arange(N))
    np.testing.assert_allclose(columns["gyro"][:, 2], 0.001 * np.arange(N))


@pytest.mark.parametrize("separator", [";", "\t"])
def test_other_separators(csv, separator):
    lines = [line.replace(",", separator) for line in rows()]
    assert read_table(csv(lines, HEADER.replace(",", separator)))["gyro"].shape == (N, 3)


def test_rows_without_kinematics_carry_no_foot_sample(csv):
    header = HEADER + "," + ",".join(f"foot{f}_{a}" for f in range(2) for a in "xyz") + ",contact0,contact1"
    lines = [row + ("," + ",".join(["0.1"] * 6) + ",1,0" if k % 3 == 0 else "," * 8) for k, row in enumerate(rows())]
    columns = read_table(csv(lines, header))
    assert columns["foot_position"].shape == (N // 3, 2, 3)
    np.testing.assert_array_equal(columns["foot_stamp_ns"], columns["stamp_ns"][::3])
    np.testing.assert_array_equal(columns["contact"][0], [1.0, 0.0])


def test_joints_keep_their_names(csv):
    columns = read_table(csv([row + ",0.1,0.2" for row in rows()], HEADER + ",joint_hip,joint_knee"))
    assert columns["joints"].shape == (N, 2)
    assert list(columns["joint_names"]) == ["hip", "knee"]


def test_an_npz_with_feet_of_their_own_rate(npz):
    feet = {"foot_t": 0.03 * np.arange(10), "foot_position": np.zeros((10, 2, 3)), "contact": np.ones((10, 2))}
    columns = read_table(npz(**feet, unknown=np.eye(2)))
    assert len(columns["foot_stamp_ns"]) == 10
    assert "unknown" not in columns


def test_sorting_puts_all_rows_in_order(csv):
    lines = rows()
    lines[7], lines[20] = lines[20], lines[7]
    np.testing.assert_array_equal(read_table(csv(lines), sort=True)["gyro"], read_table(csv(rows()))["gyro"])


def test_a_cell_that_is_no_number_names_row_and_column(csv):
    lines = rows()
    lines[4] = lines[4].replace("0.002", "off")
    error = refused(csv(lines))
    assert (error.code, error.field) == ("malformed", "gyro_y")
    assert "row 5" in error.message
    assert "'off'" in error.message


BAD_CSV = {
    "empty": ([], "", "log"),
    "no rows": ([], HEADER, "t"),
    "no rows of feet": ([], HEADER + ",foot0_x,foot0_y,foot0_z,contact0", "t"),
    "one row": (rows(1), HEADER, "t"),
    "no header": (rows(), rows(1)[0], "log"),
    "missing column": ([line.rsplit(",", 1)[0] for line in rows()], HEADER.rsplit(",", 1)[0], "acc_z"),
    "missing kind": (["0.1,1,1,1"] * 3, "t,gyro_x,gyro_y,gyro_z", "acc"),
    "no time": ([line.split(",", 1)[1] for line in rows()], HEADER.split(",", 1)[1], "t"),
    "double column": ([line + ",1" for line in rows()], HEADER + ",gyro_x", "gyro_x"),
    "truncated": ([*rows(), "0.60,0.001,0.0"], HEADER, "log"),
    "too long": ([*rows(3), rows(1)[0] + ",7"], HEADER, "log"),
    "NaN stamp": ([*rows(3), "nan" + rows(1)[0][4:]], HEADER, "t"),
    "back in time": ([*rows(9), rows(1)[0]], HEADER, "t"),
    "stamps in ms": ([f"{10 * k},0,0,0,0,0,9.81" for k in range(N)], HEADER, "t"),
    "stamps in ns": ([f"{10_000_000 * k},0,0,0,0,0,9.81" for k in range(N)], HEADER, "t"),
    "feet with a gap": ([line + ",1" for line in rows()], HEADER + ",contact1", "log"),
}


@pytest.mark.parametrize("kind", BAD_CSV)
def test_bad_csv_is_refused_by_name(csv, kind):
    lines, header, field = BAD_CSV[kind]
    assert refused(csv(lines, header)).field == field


WORDS = {
    "truncated": "row 61", "back in time": "row 9", "NaN stamp": "row 3", "stamps in ms": "0.001",
    "stamps in ns": "1e-09",
}  # fmt: skip


@pytest.mark.parametrize(("kind", "word"), WORDS.items(), ids=WORDS)
def test_bad_rows_are_numbered_and_wrong_units_of_time_come_with_the_factor(csv, kind, word):
    lines, header, _ = BAD_CSV[kind]
    assert word in refused(csv(lines, header)).message


def test_decimal_commas_are_named(csv):
    lines = [";".join(cell.replace(".", ",") for cell in line.split(",")) for line in rows()]
    assert "decimal comma" in refused(csv(lines, HEADER.replace(",", ";"))).message
    lines = [
        ",".join(cell.replace(".", ",") if "." in cell else f"{cell},0" for cell in row.split(",")) for row in rows()
    ]
    assert "decimal commas" in refused(csv(lines)).message


def test_not_text_and_not_there(tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes(b"t,gyro_x\xff\xfe\n")
    assert refused(path).code == "malformed"
    assert refused(tmp_path / "none.csv").code == "unreadable"
    assert refused(tmp_path / "log.txt").code == "invalid"


BAD_NPZ = {
    "missing": ({"gyro": None}, "gyro"),
    "shape": ({"gyro": np.zeros((N, 4))}, "gyro"),
    "flat": ({"acc": np.zeros(N)}, "acc"),
    "lengths": ({"acc": np.zeros((N - 1, 3))}, "acc"),
    "feet": ({"contact": np.ones((N, 3))}, "contact"),
    "no times of the feet": ({"foot_position": np.zeros((9, 2, 3)), "contact": np.ones((9, 2))}, "foot_t"),
    "words": ({"gyro": np.full((N, 3), "x")}, "gyro"),
    "twice": ({"w": np.zeros((N, 3))}, "gyro"),
    "two clocks": ({"stamp_ns": np.arange(N)}, "t"),
    "true quaternions of zero": (
        {"true_position": np.zeros((N, 3)), "true_quat_wxyz": np.zeros((N, 4))},
        "true_quat_wxyz",
    ),
    "a foot turned by two": (
        {"foot_quat_wxyz": np.stack([np.eye(4)[:2], 2.0 * np.eye(4)[:2]] * (N // 2))},
        "foot_quat_wxyz",
    ),
    "quaternions from elsewhere": (
        {"external_t": np.arange(1, 4) * 0.1, "external_quat_wxyz": np.full((3, 4), 0.1)},
        "external_quat_wxyz",
    ),
    "objects": ({"gyro": np.array([None] * N, dtype=object)}, "log"),
}


@pytest.mark.parametrize("kind", BAD_NPZ)
def test_bad_npz_is_refused_by_name(npz, kind):
    changes, field = BAD_NPZ[kind]
    assert refused(npz(**changes)).field == field


TIMES = 0.01 * np.arange(N)
BAD_TIMES = {
    "another clock, later": ({"foot_t": 1e5 + TIMES}, "another clock"),
    "another clock, earlier": ({"foot_t": TIMES - 1e5}, "another clock"),
    "ms": ({"foot_t": 1e3 * TIMES}, "in ms, multiply by 0.001"),
    "us as ns": ({"foot_stamp_ns": 10_000 * np.arange(N)}, "in us, multiply by 1000"),
    "far future": ({"t": 2.0 * LATEST_S + 0.125 * np.arange(N)}, "reaches"),
}


@pytest.mark.parametrize("kind", BAD_TIMES)
def test_times_that_do_not_belong_together(npz, kind):
    changes, words = BAD_TIMES[kind]
    assert words in refused(npz(**changes)).message


def test_a_log_may_have_times_of_feet_and_no_foot(npz):
    none = {"foot_position": np.zeros((0, 2, 3)), "contact": np.ones((0, 2)), "foot_t": np.zeros(0)}
    assert len(read_table(npz(**none))["foot_stamp_ns"]) == 0


def test_names_are_no_numbers_and_may_stand_in_a_log(npz):
    names = np.array(["a", "b"])
    assert list(read_table(npz(joints=np.zeros((N, 2)), joint_names=names))["joint_names"]) == ["a", "b"]


def test_external_samples_need_times(npz):
    assert refused(npz(external_yaw=np.zeros(3))).field == "external_t"


def test_an_npz_that_is_not_there(tmp_path):
    assert refused(tmp_path / "none.npz").code == "unreadable"


def test_torques_are_of_all_joints(csv):
    lines = [f"{row},0.1,0.2,3.0" for row in rows()]
    assert refused(csv(lines, HEADER + ",joint_a,joint_b,torque_a")).field == "torque_b"


def test_a_csv_without_gyro_names_what_it_has_and_the_page(csv):
    error = refused(csv(["0.1,1,1"] * 3, "t,speed,tilt"))
    assert error.field == "gyro"
    assert "it has t, speed, tilt" in error.message
    assert "docs/estimate.md" in error.message


def test_empty_lines_of_a_csv_count_for_nothing(csv):
    assert len(read_table(csv([*rows(9), "", *rows()[9:], ""]))["gyro"]) == N


def test_rows_of_a_quaternion_may_be_absent(npz):
    given = np.tile([1.0, 0.0, 0.0, 0.0], (N, 1))
    given[3:7] = np.nan
    assert read_table(npz(true_quat_wxyz=given))["true_quat_wxyz"].shape == (N, 4)


@pytest.mark.parametrize("kind", ["empty", "text", "array", "cut", "objects"])
def test_a_file_that_is_no_npz_is_refused_in_plain_words(npz, tmp_path, kind):
    path = tmp_path / f"{kind}.npz"
    whole = npz().read_bytes()
    match kind:
        case "text":
            path.write_text("hello")
        case "array":
            with path.open("wb") as file:
                np.save(file, np.arange(3))
        case "objects":
            path = npz(gyro=np.array([None] * N, dtype=object))
        case _:
            path.write_bytes(whole[: len(whole) // 2] if kind == "cut" else b"")
    words = {"empty": " is empty", "text": " begins with b'hell', allowed is an NPZ file: b'PK\\x03\\x04'"}
    words["array"] = words["text"].replace("b'hell'", "b'\\x93NUM'")
    cut = " is cut off, damaged, or holds objects that are neither numbers nor text"
    assert refused(path).message == f"{path}{words.get(kind, cut)}"


def test_a_truncated_npz(npz, tmp_path):
    whole = npz().read_bytes()
    for size in (0, 10, len(whole) // 2, len(whole) - 20):
        path = tmp_path / "cut.npz"
        path.write_bytes(whole[:size])
        assert refused(path).code == "malformed"
