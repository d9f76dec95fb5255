"""LeRobot data sets (v2 and v3): a folder with `meta/info.json` and Parquet files of episodes; video is left out.

A column of several numbers is `action[shoulder_pan]` by the names that the data set states, or `action[0]`.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.files import is_file, read_bytes
from exodrake.core.json_file import read_json
from exodrake.data.foreign.mapping import Column, Derived, Mapped
from exodrake.data.formats.parquet import read_columns
from exodrake.data.log import check_size, refuse_doubled

INFO = "meta/info.json"
EPISODE, TIME = "episode_index", "timestamp"
COMMAND, MEASURED = "action", "observation.state"
FASTEST = 1e6  # Hz
SUFFIXES = (".pos", "_pos", ".position")


def is_dataset(path: str | Path) -> bool:
    """Whether a path is the folder of a data set."""
    return is_file(Path(path) / INFO)


def read_info(path: Path) -> dict[str, Any]:
    """`meta/info.json`. InputError for one without rate or features."""
    found = read_json(path / INFO)
    rate, features = (found.get(key) if isinstance(found, dict) else None for key in ("fps", "features"))
    if not isinstance(rate, int | float) or not 0 < rate < FASTEST or not isinstance(features, dict):
        raise InputError(f"{path / INFO}: wanted 'fps' above 0 and 'features', as LeRobot writes them")
    return found


def names_of(info: dict[str, Any], column: str) -> list[str]:
    """Names of the elements of a column, as the data set states them; none if it does not."""
    feature = info["features"].get(column)
    names = feature.get("names") if isinstance(feature, dict) else None
    if isinstance(names, dict):
        names = next((item for item in names.values() if isinstance(item, list)), None)
    found = [str(name) for name in names] if isinstance(names, list) else []
    refuse_doubled(found, f"the names of {column!r} in {INFO}")
    return found


def episodes(path: Path) -> Iterator[tuple[str, dict[str, np.ndarray]]]:
    """Name and columns of each episode, in order."""
    info, files = read_info(path), sorted((path / "data").rglob("*.parquet"))
    if not files:
        raise InputError(f"{path}: no Parquet file in its folder 'data'")
    samples, place_of = 0, dict[float, Path]()
    for file in files:
        table = read_columns(read_bytes(file), str(file))
        check_size(samples := samples + sum(values.size for values in table.values()), str(path))
        if EPISODE not in table or TIME not in table:
            raise InputError(f"{file}: no column {EPISODE!r} and {TIME!r}, as a LeRobot data set has")
        if table[EPISODE].ndim > 1 or not np.isfinite(table[EPISODE]).all():
            raise InputError(f"{file}: column {EPISODE!r}: wanted one number in each row")
        for number in np.unique(table[EPISODE]):
            if number in place_of:
                other = place_of[number].relative_to(path)
                raise InputError(f"{file}: episode {int(number)} is also in {other}, so one of them would be lost")
            place_of[number] = file
            rows = table[EPISODE] == number
            columns: dict[str, np.ndarray] = {}
            for name, values in table.items():
                columns |= elements(name, values[rows], names_of(info, name))
            yield f"episode_{int(number):06d}", columns


def elements(name: str, values: np.ndarray, names: list[str]) -> dict[str, np.ndarray]:
    """A column (n,), or those of a matrix (n, m) by index and by name."""
    if values.ndim == 1:
        return {name: values}
    found = {f"{name}[{k}]": values[:, k] for k in range(values.shape[1])}
    if len(names) == values.shape[1]:
        found |= {f"{name}[{one}]": values[:, k] for k, one in enumerate(names)}
    return found


def default_mapping(path: Path, unit: str) -> Mapped:
    """Actions as commands and states as angles, in a unit that the data set does not state.

    Raises:
        InputError: without a unit, or for a data set whose actions and states are not the same joints.
    """
    info = read_info(path)
    if not unit:
        raise InputError(f"{path}: a LeRobot data set states no unit of its joints; --unit deg, for instance")
    command, measured = names_of(info, COMMAND), names_of(info, MEASURED)
    if not command or command != measured:
        raise InputError(f"{path}: {COMMAND} and {MEASURED} do not name the same joints; write a mapping file")
    columns = []
    refuse_doubled(map(joint_name, command), f"{path}: joints of {COMMAND}")
    for name in command:
        joint = joint_name(name)
        columns.append(Column(f"{COMMAND}[{name}]", f"angle_ref_{joint}", unit))
        columns.append(Column(f"{MEASURED}[{name}]", f"angle_{joint}", unit))
    starts = tuple(Derived(f"angle_start_{joint_name(n)}", f"angle_{joint_name(n)}", take="first") for n in command)
    return Mapped(tuple(columns), time=TIME, start=0.0, period=1.0 / float(info["fps"]), derived=starts)


def joint_name(name: str) -> str:
    """`shoulder_pan.pos` as a channel: `shoulderPan`."""
    bare = name
    for suffix in SUFFIXES:
        bare = bare.removesuffix(suffix)
    words = [word for word in bare.replace(".", "_").replace("-", "_").split("_") if word]
    if not words:
        raise InputError(f"{name!r} is no name of a joint; write a mapping file")
    first, *rest = words
    return first + "".join(word[0].upper() + word[1:] for word in rest)
