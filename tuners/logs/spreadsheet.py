"""Spreadsheets of Excel and LibreOffice: the first sheet that holds a table."""

from datetime import datetime, time, timedelta
from io import BytesIO
from typing import Any

from tuners.logs import csv_file
from tuners.logs.table import LogError, Table


def read(content: bytes) -> Table:
    """Read xlsx, xls, xlsb or ods, as a text table of the same cells."""
    try:
        from python_calamine import CalamineWorkbook
    except ImportError:
        raise LogError(
            'Spreadsheets need python-calamine: pip install "yawrate[xlsx]"; or save as CSV.'
        ) from None
    try:
        book = CalamineWorkbook.from_object(BytesIO(content))
        sheets = [book.get_sheet_by_index(k).to_python() for k in range(len(book.sheet_names))]
    except Exception as error:  # calamine raises all kinds on damaged files
        reason = str(error) or type(error).__name__
        raise LogError(f"The spreadsheet cannot be read: {reason}") from None
    except BaseException as error:  # so does a panic of Rust
        if type(error).__name__ != "PanicException":
            raise
        raise LogError("The spreadsheet cannot be read: it is damaged.") from None
    refused = LogError("The spreadsheet is empty.")
    for rows in sheets:
        try:
            return csv_file.table_of("\n".join("\t".join(map(_cell, row)) for row in rows))
        except LogError as error:
            refused = error
    raise refused


def _cell(value: Any) -> str:
    if isinstance(value, datetime):
        return value.isoformat(" ", "microseconds")
    if isinstance(value, time):
        return value.isoformat("microseconds")
    if isinstance(value, timedelta):
        return str(value.total_seconds())
    return str(value).replace("\t", " ").replace("\n", " ")
