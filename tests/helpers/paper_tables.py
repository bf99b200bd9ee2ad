"""The source paper's tables (examples/paper/tables.py), which the tests share with the repeated experiment."""

import importlib.util

from helpers.data import ROOT

FOLDER = ROOT / "examples" / "paper"
_SPEC = importlib.util.spec_from_file_location("tables_of_the_paper", FOLDER / "tables.py")
TABLES = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(TABLES)

LIMITS, FUNDAMENTAL, SIN_COEF, COS_COEF, OFFSET = (
    TABLES.LIMITS,
    TABLES.FUNDAMENTAL,
    TABLES.SIN_COEF,
    TABLES.COS_COEF,
    TABLES.OFFSET,
)
table_1, table_3, sampling_times = TABLES.table_1, TABLES.table_3, TABLES.sampling_times
