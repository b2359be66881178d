"""A film as one HTML page with data and player, which needs only a browser."""

from __future__ import annotations

import base64
import json
import re
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexlink.common.types import Array
from flexlink.results.pictures.colouring import STOPS, UNKNOWN
from flexlink.results.pictures.film import Film
from flexlink.results.pictures.projection import (
    AROUND,
    Projected,
    digits_of_time,
    floor_level,
    floor_of,
    number,
    subtitle,
)


def page(film: Film, width: int) -> str:
    """Return the HTML page, that is, the template filled with title, data and texts."""
    template = (files("flexlink.results.pictures") / "data" / "player.html").read_text(encoding="utf-8")
    data = json.dumps(data_of(film), ensure_ascii=False, allow_nan=False).replace("<", "\\u003c")
    title = film.name.replace("&", "&amp;").replace("<", "&lt;")
    parts = {"title": title, "width": str(width), "data": data}
    # all at once, since a name may contain {{data}}
    return re.sub(r"\{\{(title|width|data)\}\}", lambda part: parts[part[1]], template)


def data_of(film: Film) -> dict[str, Any]:
    """Data for the player; arrays are float32, and colours are bytes; the byte 255 means no value."""
    projected, outline, found = Projected(film), film.outline, film.colouring
    pivot, window = turned_window(projected)
    poses = np.concatenate([film.p, film.R[..., 1], film.R[..., 2]], axis=-1)  # origin, y and z of every body
    level = np.nan_to_num(found.values / found.largest * 254, nan=255.0) if found.largest else found.values * 0 + 255
    return {
        "name": film.name,
        "about": film.about,
        "subtitle": subtitle(film),
        "fps": film.fps,
        "digits": digits_of_time(film),
        "bodies": film.p.shape[1],
        "t": _floats(film.t),
        "poses": _floats(poses),
        "values": base64.b64encode(np.nan_to_num(level, nan=255.0).round().astype(np.uint8).tobytes()).decode(),
        "link": outline.link.tolist(),
        "body": outline.body.tolist(),
        "place": _floats(outline.place),
        "axes": _floats(outline.axes),
        "across": _floats(outline.across),
        "round": outline.round.astype(int).tolist(),
        "railBody": outline.rails[0].tolist(),
        "railPlace": _floats(outline.rails[1]),
        "order": outline.order.tolist(),
        "joints": outline.joints.tolist(),
        "radii": projected.joint_radii.tolist(),
        "ball": projected.ball_radius,
        "base": projected.base_half,
        "baseBody": outline.base,
        "center": outline.center.tolist(),
        "trace": _floats(film.trace),
        "traceT": _floats(film.trace_t),
        "view": film.view.axes.tolist(),
        "vertical": film.view.vertical.tolist(),
        "spatial": film.view.spatial,
        "pivot": pivot.tolist(),
        "window": window,
        "thinnest": projected.thinnest[0],
        "floor": floor_of(film).tolist() if film.view.spatial else [],
        "level": floor_level(film),
        "stops": list(STOPS),
        "unknown": UNKNOWN,
        "label": found.label if found.largest else "",
        "ticks": [number(part * found.largest) for part in (0.0, 0.5, 1.0)],
    }


def turned_window(projected: Projected) -> tuple[Array, list[float]]:
    """Return the point in the middle of the window [m], and its left, right, bottom and top edges from there [m].

    The window contains the arm at all times, and a spatial arm for any rotation about the vertical through that point.
    If the view is from an angle e above the horizon, the height in the picture of a point at height h and distance r
    from that vertical is at most h cos e + r sin e.
    """
    film, view = projected.film, projected.view
    if not view.spatial:
        return np.zeros(3), list(projected.window)
    found, v = np.concatenate([part.reshape(-1, 3) for part in (film.points, film.bodies, film.ball)]), view.vertical
    heights, level = found @ v, found - (found @ v)[:, None] * v
    pivot = (level.min(axis=0) + level.max(axis=0)) / 2
    r = float(np.linalg.norm(level - pivot, axis=1).max()) + projected.thickest
    cos_e, sin_e, room = float(view(v)[1]), float(view.axes[2] @ v), AROUND * 2 * r
    low, high = cos_e * min(heights.min(), floor_level(film)), cos_e * (heights.max() + projected.thickest)
    return pivot, [-r - room, r + room, low - sin_e * r - room, high + sin_e * r + room]


def _floats(values: ArrayLike) -> str:
    return base64.b64encode(np.asarray(values, dtype="<f4").tobytes()).decode()
