"""Outputs of a slow plant's simulator, kept in a file that one training at a time uses."""

import json
import os
import sqlite3
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from yawrate_env.plant.fingerprint import changed, fingerprint
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]


class Store:
    """Outputs by their keys in an SQLite file, which survives that its process is killed.

    Parameters
    ----------
    path : path, optional
        The file; a temporary one if omitted.
    plant : Plant
        Whose outputs they are; ``ValueError`` where the file holds another's.
    """

    def __init__(self, path: str | os.PathLike[str] | None, plant: Plant) -> None:
        self._path, self._lock = path, Lock()  # of the thread that asks, and of the workers'
        try:
            self._db = sqlite3.connect(
                path or "", isolation_level=None, timeout=1.0, check_same_thread=False
            )
            self._db.execute("PRAGMA locking_mode = EXCLUSIVE")
            self._db.execute("PRAGMA synchronous = OFF")  # a crash of the system may cost the file
            self._db.execute("BEGIN EXCLUSIVE")  # one training at a time
            self._db.execute("COMMIT")
            self._db.execute("CREATE TABLE IF NOT EXISTS plants (fingerprint TEXT)")
            self._db.execute(
                "CREATE TABLE IF NOT EXISTS outputs (key BLOB PRIMARY KEY, y BLOB) WITHOUT ROWID"
            )
            (self._count,) = self._db.execute("SELECT COUNT(*) FROM outputs").fetchone()
        except sqlite3.Error as error:
            raise ValueError(
                f"checkpoint = {os.fsdecode(path or '')!r} cannot be used: {error}. Name a new "
                "file, or the one of the same training when it no longer runs."
            ) from None
        if path is not None:
            try:
                self._check(plant)
            except BaseException:
                self.close()
                raise

    def __len__(self) -> int:
        return int(self._count)

    def get(self, key: bytes) -> Array | None:
        """The output (N,) with this key, or None."""
        with self._lock:
            row = self._db.execute("SELECT y FROM outputs WHERE key = ?", (key,)).fetchone()
        return None if row is None else np.frombuffer(row[0])

    def put(self, key: bytes, y: Array) -> None:
        """Keep an output (N,)."""
        with self._lock:
            known = self._db.execute("SELECT 1 FROM outputs WHERE key = ?", (key,)).fetchone()
            if known is None:
                self._db.execute("INSERT INTO outputs VALUES (?, ?)", (key, y.tobytes()))
                self._count += 1

    def close(self) -> None:
        """Close the file."""
        self._db.close()

    def _check(self, plant: Plant) -> None:
        """``ValueError`` for a file of another plant; a new file becomes this plant's."""
        row = self._db.execute("SELECT fingerprint FROM plants").fetchone()
        if row is None:
            now = json.dumps(fingerprint(plant))
            self._db.execute("INSERT INTO plants VALUES (?)", (now,))
        elif other := changed(plant, json.loads(row[0])):
            raise ValueError(
                f"checkpoint = {os.fsdecode(self._path or '')!r} is of another plant: since then "
                f"its {other} changed. Delete it, or name another file."
            )
