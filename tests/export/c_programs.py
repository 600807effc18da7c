"""Compile and run generated C."""

import shutil
import subprocess

import numpy as np
import pytest

STRICT = ("-Wconversion", "-Wshadow", "-Wstrict-prototypes", "-Wmissing-prototypes", "-O2")

DRIVER = """\
#include "yawrate_tuner.h"

#include <stdio.h>

#ifdef YAWRATE_TUNER_MEASURED
#define MEASURED measured,
#else
#define MEASURED
#define YAWRATE_TUNER_MEASURED 0
#endif

static double next(void)
{
    double value = 0.0;

    if (fread(&value, sizeof value, 1, stdin) != 1) {
        value = 0.0;
    }
    return value;
}

/* Recordings: number of samples, measured parameters, samples; or 0, parameters, features. */
int main(void)
{
    static yawrate_laguerre_state state;
    double measured[YAWRATE_TUNER_MEASURED + 1];
    double features[YAWRATE_LAGUERRE_FEATURES];
    double gains[YAWRATE_TUNER_GAINS];
    double count;
    int i;

    while (fread(&count, sizeof count, 1, stdin) == 1) {
        for (i = 0; i < YAWRATE_TUNER_MEASURED; i++) {
            measured[i] = next();
        }
        if (count > 0.0) {
            yawrate_laguerre_start(&state);
            for (; count > 0.0; count -= 1.0) {
                const double input = next();

                yawrate_laguerre_sample(&state, input, next());
            }
            i = yawrate_tuner_solve(&state, MEASURED gains);
        } else {
            for (i = 0; i < YAWRATE_LAGUERRE_FEATURES; i++) {
                features[i] = next();
            }
            i = yawrate_tuner_gains(features, MEASURED gains);
        }
        (void)measured;
        (void)printf("%d", i);
        for (i = 0; i < YAWRATE_TUNER_GAINS; i++) {
            (void)printf(" %.17g", gains[i]);
        }
        (void)printf("\\n");
    }
    return 0;
}
"""


def compiled(folder, *sources, flags=(), data=b""):
    """Compile sources of a folder, strictly, and run the program."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler")
    program = folder / "program"
    command = [compiler, "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", *flags]
    paths = [str(folder / name) for name in sources]
    subprocess.run([*command, *paths, "-o", str(program), "-lm"], check=True)
    return subprocess.run([str(program)], capture_output=True, input=data)


def written(folder, files):
    """Write a program's files by name."""
    for name, text in files.items():
        (folder / name).write_text(text)
    return folder


def notices(folder, source, mistakes, *names):
    """Whether the test program fails for each mistake in a source, by what it replaces."""
    path, found = folder / source, []
    right = path.read_text()
    for before, after in mistakes.items():
        assert before in right, before
        path.write_text(right.replace(before, after))
        parts = [f"{name}.c" for name in names]
        done = compiled(folder, *parts, f"{names[-1]}_test.c", flags=["-Wno-unused"])
        found.append(done.returncode == 1)
    path.write_text(right)
    return all(found)


def passes(folder, *names):
    """Whether the test program of the last of these parts agrees with its golden vectors."""
    sources = [f"{name}.c" for name in names]
    done = compiled(folder, *sources, f"{names[-1]}_test.c", flags=STRICT)
    return (done.returncode, done.stdout) == (0, b"")


def answers(folder, rows):
    """Gains (B, k) and status (B,) of an exported tuner for rows of numbers that `DRIVER` reads."""
    (folder / "driver.c").write_text(DRIVER)
    data = b"".join(np.concatenate(row).astype(np.float64).tobytes() for row in rows)
    parts = "driver.c", "yawrate_laguerre.c", "yawrate_tuner.c"
    lines = compiled(folder, *parts, data=data).stdout.decode().splitlines()
    found = np.array([[float(text) for text in line.split()] for line in lines])
    return found[:, 1:], found[:, 0].astype(int)
