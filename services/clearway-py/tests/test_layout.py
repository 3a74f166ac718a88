"""The declarations of this package beside the layout that Rust's compiler made."""

import ctypes
import json
import re
import unittest
from pathlib import Path

import numpy as np

from clearway import codes, layout, refusals, wheel

HERE = Path(__file__).resolve().parent
LAYOUT = json.loads((HERE / "layout.json").read_text())
# For recorders, whose format belongs to one version of the daemon.
NOT_HERE = {"clearway.v1.CheckpointHeader", "clearway.v1.RobotCheckpoint"}
RECORDS = {
    kind.type_name(): kind
    for kind in vars(layout).values()
    if isinstance(kind, type) and issubclass(kind, layout.Record) and kind is not layout.Record
}


class Layout(unittest.TestCase):
    def test_every_record_is_declared(self):
        self.assertEqual(set(RECORDS), set(LAYOUT["records"]) - NOT_HERE)

    def test_names_sizes_offsets_and_types_are_rusts(self):
        types = {"u32": ctypes.c_uint32, "u64": ctypes.c_uint64, "f64": ctypes.c_double}
        types["RobotIntent"] = layout.RobotIntent
        for name, record in RECORDS.items():
            expected = LAYOUT["records"][name]
            with self.subTest(name):
                self.assertEqual(ctypes.sizeof(record), expected["size"])
                self.assertEqual(ctypes.alignment(record), expected["align"])
                fields = [
                    [field, getattr(record, field).offset, getattr(record, field).size, kind]
                    for field, kind in record._fields_
                ]
                wanted = [[field, at, size, types[kind]] for field, at, size, kind in expected["fields"]]
                self.assertEqual(fields, wanted)

    def test_numpy_sees_the_same(self):
        kinds = {"u32": np.uint32, "u64": np.uint64, "f64": np.float64}
        kinds["RobotIntent"] = layout.RobotIntent.dtype()
        for name, record in RECORDS.items():
            dtype, expected = record.dtype(), LAYOUT["records"][name]
            with self.subTest(name):
                self.assertEqual(dtype.itemsize, expected["size"])
                fields = [[field, dtype.fields[field][1], dtype.fields[field][0]] for field in dtype.names]
                wanted = [[field, at, np.dtype(kinds[kind])] for field, at, _, kind in expected["fields"]]
                self.assertEqual(fields, wanted)

    def test_a_record_reads_the_bytes_that_an_array_wrote(self):
        array = np.zeros(2, layout.RobotState.dtype())
        array[1]["id"], array[1]["goal_y_m"], array[1]["intent"]["rank"] = 7, -2.5, 9
        record = layout.RobotState.from_buffer_copy(array.tobytes(), array.itemsize)
        self.assertEqual((record.id, record.goal_y_m, record.intent.rank), (7, -2.5, 9))

    def test_codes_and_flags_are_rusts(self):
        pairs = {**LAYOUT["codes"]}
        for name, members in LAYOUT["flags"].items():
            pairs["".join(part.capitalize() for part in name.split("_"))] = members
        del pairs["CheckpointFlags"]
        for name, members in pairs.items():
            with self.subTest(name):
                ours = {member.name.lower(): member.value for member in getattr(codes, name)}
                self.assertEqual(ours, members)
        self.assertEqual(codes.NO_ROBOT, LAYOUT["no_robot"])

    def test_every_refusal_has_its_exception(self):
        self.assertEqual(set(refusals.BY_CODE), set(codes.AdminCode) - {codes.AdminCode.DONE})
        self.assertEqual(len(set(refusals.BY_CODE.values())), len(refusals.BY_CODE))
        for code, kind in refusals.BY_CODE.items():
            self.assertEqual(kind.__name__.removesuffix("Error").lower(), code.name.replace("_", "").lower())
            raised = refusals.refusal(int(code), 3, "because")
            self.assertIs(type(raised), kind)
            self.assertEqual((raised.code, raised.robot, raised.text), (code, 3, "because"))
        later = refusals.refusal(999, None, "because")
        self.assertIs(type(later), refusals.RefusedError)
        self.assertEqual((later.code, str(later)), (999, "refused (code 999): because"))

    def test_iceoryx2_is_the_daemons(self):
        manifest = (HERE.parent.parent.parent / "Cargo.toml").read_text()
        (daemons,) = re.findall(r'^iceoryx2 = \{ version = "=([0-9.]+)"', manifest, re.MULTILINE)
        self.assertEqual(wheel.VERSION, daemons)
        for file in ("../pyproject.toml", "requirements.txt"):
            self.assertIn(f"iceoryx2=={daemons}", (HERE / file).read_text())
