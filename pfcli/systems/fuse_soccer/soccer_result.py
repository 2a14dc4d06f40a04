"""What a run hands over."""

import math

import numpy as np

from pfcli.formats import field_yaml
from pfcli.systems.fuse_soccer.field_assets import Assets
from pfcli.systems.fuse_soccer.params import Params
from pfcli.systems.fuse_soccer.sighting_likelihood import turned
from pfcli.systems.fuse_soccer.soccer_state import State
from pfcli.systems.shared.contract import Result


def finish(state: State, assets: Assets, params: Params) -> Result:
    """Track, the other side of it, and the field."""
    track = state.track.track({"mirror_p": np.array(state.mirror_p)})
    other = turned(track.poses)
    columns = track.columns | dict(zip(("mirror_x_m", "mirror_y_m", "mirror_yaw_rad"), other.T, strict=True))
    since = (state.certain_ns[0] - int(track.stamps_ns[0])) * 1e-9 if state.certain_ns else None
    summary = {
        "updates": int(track.columns["update"].sum()),
        "certain_since_s": None if since is None else round(since, 3),
        "injections": len(state.injected_ns),
        "mirror_p_at_end": round(state.mirror_p[-1], 4),
        "compass_bias_deg": round(math.degrees(state.bias.mean_rad), 2),
        "particles": int(state.belief.pose.shape[0]),
    }
    field = field_yaml.drawn(assets.field, assets.table)
    return Result(track._replace(columns=columns), field, state.frames.frames(), summary, given_frame=True)
