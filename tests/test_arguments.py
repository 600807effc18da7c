"""Arguments of the scripts: what is taken, what is refused, how errors end."""

import argparse
import os

import pytest

import arguments
from yawrate_env.vehicle.nonlinear import NonlinearTwin, Tyre
from yawrate_env.vehicle.task import Task


@pytest.mark.parametrize("text, value", [("1", 1), ("1500", 1500), ("2e3", 2000), ("4.0", 4)])
def test_whole_numbers(text, value):
    assert arguments.whole(text) == value and isinstance(arguments.whole(text), int)


@pytest.mark.parametrize(
    "text", ["0", "-3", "1.5", "inf", "-inf", "nan", "1e10", "1e400", "many", ""]
)
def test_what_is_not_a_positive_whole_number(text):
    # argparse turns exactly these two into a message.
    with pytest.raises((argparse.ArgumentTypeError, ValueError)):
        arguments.whole(text)


def test_seeds():
    assert arguments.seed("0") == 0
    for text in ("-1", "1.5", "x"):
        with pytest.raises((argparse.ArgumentTypeError, ValueError)):
            arguments.seed(text)


def test_output_is_a_file_in_a_folder_that_exists(tmp_path):
    assert arguments.output(str(tmp_path / "rows.csv")) == tmp_path / "rows.csv"
    os.mkfifo(tmp_path / "pipe")
    for wrong in (tmp_path / "absent" / "rows.csv", tmp_path, tmp_path / "pipe"):
        with pytest.raises(argparse.ArgumentTypeError, match=str(tmp_path)):
            arguments.output(str(wrong))


def test_environment_arguments_are_a_json_object():
    assert arguments.environment_kwargs('{"snr_db": 20, "v_x": [10, 30]}') == {
        "snr_db": 20,
        "v_x": [10, 30],
    }
    for text, message in (("{", "not JSON"), ("[1]", "JSON object"), ("", "not JSON")):
        with pytest.raises(argparse.ArgumentTypeError, match=message):
            arguments.environment_kwargs(text)


def test_the_task_is_the_environments():
    assert arguments.environment({}).task == Task()
    task = arguments.environment({"snr_db": 20, "v_x": [10, 30], "crossover": 1.2}).task
    assert (task.experiment.snr_db, task.prior.v_x, task.target.crossover) == (20, (10, 30), 1.2)
    with pytest.raises(ValueError, match="--env-kwargs: unexpected keyword argument 'snr'"):
        arguments.environment({"snr": 20})
    nonlinear = arguments.environment({"nonlinear": True, "tyre": {"friction": 0.8}}).task
    assert nonlinear.twin == NonlinearTwin(tyre=Tyre(friction=0.8))
    with pytest.raises(ValueError, match="--env-kwargs: unexpected keyword argument 'tyre'"):
        arguments.environment({"tyre": {}})
    with pytest.raises(ValueError, match="Ts = -1"):
        arguments.environment({"Ts": -1})


@pytest.mark.parametrize(
    "error",
    [ValueError("wrong"), FileNotFoundError(2, "absent"), OverflowError("x"), MemoryError()],
)
def test_users_errors_are_one_line_and_status_two(error, capsys):
    def main():
        raise error

    with pytest.raises(SystemExit) as caught:
        arguments.run(main)
    assert caught.value.code == 2
    output = capsys.readouterr()
    assert output.err == f"error: {error}\n" and output.out == ""


def test_our_own_errors_keep_their_traceback():
    def main():
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        arguments.run(main)
