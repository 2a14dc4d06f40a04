"""Reference tracks as people keep them."""

import math
from pathlib import Path

import numpy as np
import pytest

from pfcli.errors import LogError
from pfcli.formats import reference_track

T0 = 1_600_000_000
POSES = np.array([[0.5 * k, 0.2 * k * k, 0.3 * k] for k in range(12)])


def _rows(form: str) -> list[str]:
    out = []
    for k, (x, y, yaw) in enumerate(POSES.tolist()):
        s, c = math.sin(yaw / 2), math.cos(yaw / 2)
        out.append(
            form.format(t=f"{T0 + k}.5", ns=f"{T0 + k}500000000", ms=f"{T0 + k}500", x=x, y=y, yaw=yaw, s=s, c=c)
        )
    return out


FORMS = {
    "tum": ("", "{t} {x} {y} 0 0 0 {s} {c}"),
    "tum in ms": ("", "{ms} {x} {y} 0 0 0 {s} {c}"),
    "euroc": (
        "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []",
        "{ns},{x},{y},0.1,{c},0,0,{s}",
    ),
    "csv": ("time,speed,x,y,yaw", "{t},9,{x},{y},{yaw}"),
    "csv in ms": ("stamp;x_m;y_m;heading", "{ms};{x};{y};{yaw}"),
    "csv quaternion": ("timestamp,qx,qy,qz,qw,x,y", "{ns},0,0,{s},{c},{x},{y}"),
}


@pytest.mark.parametrize("form", sorted(FORMS))
def test_each_format_gives_the_same_poses(form: str, tmp_path: Path) -> None:
    head, row = FORMS[form]
    path = tmp_path / "truth.csv"
    path.write_text("\n".join([*([head] if head else []), *_rows(row)]) + "\n")
    stamps, poses = reference_track.read(path)
    assert stamps.tolist() == [(T0 + k) * 10**9 + 500_000_000 for k in range(12)]
    off = poses - POSES
    off[:, 2] = np.arctan2(np.sin(off[:, 2]), np.cos(off[:, 2]))
    assert np.abs(off).max() < 1e-6


def test_kitti_needs_its_stamps(tmp_path: Path) -> None:
    path = tmp_path / "07.txt"
    rows = []
    for x, y, yaw in POSES.tolist():
        c, s = math.cos(yaw), math.sin(yaw)
        # the camera's frame: z ahead, x to the right
        rows.append(f"{c} 0 {-s} {-y} 0 1 0 0 {s} 0 {c} {x}")
    path.write_text("\n".join(rows))
    with pytest.raises(LogError, match=r"no stamps; put them.*times\.txt"):
        reference_track.read(path)
    (tmp_path / "times.txt").write_text("\n".join(str(0.1 * k) for k in range(12)))
    stamps, poses = reference_track.read(path)
    assert stamps[1] == 100_000_000
    off = poses - POSES
    off[:, 2] = np.arctan2(np.sin(off[:, 2]), np.cos(off[:, 2]))
    assert np.abs(off).max() < 1e-9


@pytest.mark.parametrize("row", ["{t} {x} {y}", "{t} {x} {y} 0 0 0 0 1", "{t},{x},{y},0"])
def test_positions_alone_have_no_heading(row: str, tmp_path: Path) -> None:
    path = tmp_path / "gps.tum"
    path.write_text("\n".join(_rows(row)))
    _, poses = reference_track.read(path)
    assert np.allclose(poses[:, :2], POSES[:, :2])
    assert np.isnan(poses[:, 2]).all()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("time,lon,lat\n1,2,3\n", "no column x; it has time, lon, lat"),
        ("time,x,y\n1,2\n", "line 2 has fewer columns"),
        ("time,x,y\n1,2,b\n", "line 2 does not hold"),
        ("t,x,y,qx,qy,qz,qw\n1,2,3,0,0,0,0\n", "line 2 has a quaternion"),
        ("time,x,y\nnow,2,3\n", "stamp that is no number"),
        ("", "holds no pose"),
    ],
)
def test_what_is_wrong_is_named(text: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    path.write_text(text)
    with pytest.raises(LogError, match=says):
        reference_track.read(path)
