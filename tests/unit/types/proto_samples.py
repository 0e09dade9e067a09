"""Message types of Protocol Buffers for tests, built without protoc, and the library's own classes for them."""

import pytest

pytest.importorskip("google.protobuf")

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

F = descriptor_pb2.FieldDescriptorProto
SCALARS = [
    "double", "float", "int64", "uint64", "int32", "fixed64", "fixed32", "bool", "string", "bytes", "uint32",
    "sfixed32", "sfixed64", "sint32", "sint64",
]  # fmt: skip


def add(message, name, number, kind, *, repeated=False, target=None, oneof=None, optional=False, packed=None):
    field = message.field.add(name=name, number=number, type=getattr(F, f"TYPE_{kind.upper()}"))
    field.label = F.LABEL_REPEATED if repeated else F.LABEL_OPTIONAL
    if target:
        field.type_name = target
    if oneof is not None:
        field.oneof_index = oneof
    if optional:
        field.proto3_optional = True
    if packed is not None:
        field.options.packed = packed
    return field


def add_map(message, name, number, key, value, *, target=None, package="test."):
    entry = message.nested_type.add(name=f"{name.capitalize()}Entry")
    entry.options.map_entry = True
    add(entry, "key", 1, key)
    add(entry, "value", 2, value, target=target)
    add(message, name, number, "message", repeated=True, target=f".{package}{message.name}.{entry.name}")


def build_set():
    """Return a descriptor set of proto3, proto2 and one file that the first imports."""
    found = descriptor_pb2.FileDescriptorSet()
    base = found.file.add(name="base.proto", package="test", syntax="proto3")
    vector = base.message_type.add(name="Vector")
    for number, name in enumerate(("x", "y", "z"), 1):
        add(vector, name, number, "double")
    for place, comment in (((4, 0, 2, 0), " Distance ahead [m]\n"), ((4, 0, 2, 1), " to the left, in metres\n")):
        base.source_code_info.location.add(path=place, trailing_comments=comment)
    mode = base.enum_type.add(name="Mode")
    for number, name in ((0, "OFF"), (1, "ON"), (-3, "BROKEN")):
        mode.value.add(name=name, number=number)

    main = found.file.add(name="main.proto", package="test", syntax="proto3", dependency=["base.proto"])
    every = main.message_type.add(name="Every")
    for number, kind in enumerate(SCALARS, 1):
        add(every, f"f_{kind}", number, kind)
        add(every, f"r_{kind}", number + 100, kind, repeated=True)
    add(every, "mode", 20, "enum", target=".test.Mode")
    add(every, "modes", 21, "enum", repeated=True, target=".test.Mode")
    add(every, "unpacked", 22, "int32", repeated=True, packed=False)
    add(every, "at", 30, "message", target=".test.Vector")
    add(every, "path", 31, "message", repeated=True, target=".test.Vector")
    add(every, "inner", 32, "message", target=".test.Every")
    every.oneof_decl.add(name="choice")
    every.oneof_decl.add(name="_maybe")
    add(every, "number", 40, "int32", oneof=0)
    add(every, "text", 41, "string", oneof=0)
    add(every, "place", 42, "message", target=".test.Vector", oneof=0)
    add(every, "maybe", 43, "int32", oneof=1, optional=True)
    add_map(every, "counts", 50, "string", "int32")
    add_map(every, "spots", 51, "int32", "message", target=".test.Vector")
    add_map(every, "flags", 52, "bool", "string")

    new = found.file.add(name="new.proto", package="new", syntax="editions", edition=1000, dependency=["base.proto"])
    edition = new.message_type.add(name="Edition")
    add(edition, "explicit", 1, "int32")
    add(edition, "implicit", 2, "int32").options.features.field_presence = 2
    add(edition, "packed", 3, "int32", repeated=True)
    add(edition, "expanded", 4, "int32", repeated=True).options.features.repeated_field_encoding = 2
    add(edition, "delimited", 5, "message", target=".test.Vector").options.features.message_encoding = 2
    add(edition, "path", 6, "message", repeated=True, target=".test.Vector").options.features.message_encoding = 2

    old = found.file.add(name="old.proto", package="old", syntax="proto2")
    legacy = old.message_type.add(name="Legacy")
    add(legacy, "id", 1, "int32").label = F.LABEL_REQUIRED
    add(legacy, "note", 2, "string")
    add(legacy, "values", 3, "sint32", repeated=True)
    group = legacy.nested_type.add(name="Part")
    add(group, "x", 1, "float")
    add(legacy, "part", 4, "group", target=".old.Legacy.Part")
    add(legacy, "parts", 5, "group", repeated=True, target=".old.Legacy.Part")
    return found


SET = build_set()
POOL = descriptor_pool.DescriptorPool()
for _file in SET.file:
    POOL.Add(_file)


def cls(name):
    """Return the library's class of a message."""
    return message_factory.GetMessageClass(POOL.FindMessageTypeByName(name))


def every(**values):
    """Return a message that has many fields set."""
    found = cls("test.Every")(
        f_double=1.5, f_float=-2.25, f_int64=-5, f_uint64=1 << 63, f_int32=300, f_fixed64=7, f_fixed32=8, f_bool=True,
        f_string="héllo", f_bytes=b"\x00\xff", f_uint32=5, f_sfixed32=-9, f_sfixed64=-10, f_sint32=-11, f_sint64=12,
        r_double=[1.0, 2.0], r_float=[0.5], r_int64=[-1, 0, 300], r_bool=[True, False], r_string=["a", "", "ccc"],
        r_sint32=[-1, 70000], r_fixed32=[1, 2, 3], mode=1, modes=[1, 0], unpacked=[1, 200, 3],
        at={"x": 1.0, "z": -3.0}, path=[{"x": 1}, {"y": 2}, {}], inner={"f_int32": 3, "inner": {"f_string": "deep"}},
        number=42, maybe=0, counts={"left": 1, "odd key": 300}, flags={True: "yes"},
    )  # fmt: skip
    found.spots[3].x = 4.0  # before protobuf 6.30, maps of messages take no dicts
    found.spots[-1].SetInParent()
    for name, value in values.items():
        setattr(found, name, value)
    return found


def legacy():
    """Return a message of proto2 with groups."""
    found = cls("old.Legacy")(id=7, note="n", values=[-1, 2, 300])
    found.part.x = 1.5
    found.parts.add().x = 2.5
    found.parts.add()
    return found
