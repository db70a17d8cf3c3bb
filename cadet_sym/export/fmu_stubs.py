"""Functions of the FMI standards that our units have no use for, each of which must be there and refuse."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

__all__ = ["stubs_2", "stubs_3"]

_R2 = "const fmi2ValueReference r[], size_t n"
_R3 = "const fmi3ValueReference r[], size_t n"


def stubs_2() -> str:
    """Everything but real variables and co-simulation."""
    arguments = {"SetDebugLogging": "fmi2Boolean on, size_t n, const fmi2String r[]"}
    for kind in ("Integer", "Boolean", "String"):
        arguments[f"Get{kind}"] = f"{_R2}, fmi2{kind} v[]"
        arguments[f"Set{kind}"] = f"{_R2}, const fmi2{kind} v[]"
    arguments["GetDirectionalDerivative"] = (
        f"{_R2}, const fmi2ValueReference knowns[], size_t m, const fmi2Real seed[], fmi2Real v[]"
    )
    arguments["SetRealInputDerivatives"] = f"{_R2}, const fmi2Integer order[], const fmi2Real v[]"
    arguments["GetRealOutputDerivatives"] = f"{_R2}, const fmi2Integer order[], fmi2Real v[]"
    for name in ("", "Real", "Integer", "Boolean", "String"):
        arguments[f"Get{name}Status"] = f"const fmi2StatusKind kind, fmi2{name or 'Status'} *v"
    return "\n".join(_stubs("fmi2", "Component", arguments, ("SetDebugLogging", "Integer", "Boolean", "String")))


def stubs_3() -> str:
    """Everything but 64-bit floating-point variables and model exchange."""
    arguments = {"SetDebugLogging": "fmi3Boolean on, size_t n, const fmi3String r[]"}
    for kind in ("Float32", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64", "Boolean", "String"):
        arguments[f"Get{kind}"] = f"{_R3}, fmi3{kind} v[], size_t m"
        arguments[f"Set{kind}"] = f"{_R3}, const fmi3{kind} v[], size_t m"
    arguments |= {
        "GetBinary": f"{_R3}, size_t sizes[], fmi3Binary v[], size_t m",
        "SetBinary": f"{_R3}, const size_t sizes[], const fmi3Binary v[], size_t m",
        "GetClock": f"{_R3}, fmi3Clock v[]",
        "SetClock": f"{_R3}, const fmi3Clock v[]",
        "GetNumberOfVariableDependencies": "fmi3ValueReference r, size_t *v",
        "GetVariableDependencies": "fmi3ValueReference r, size_t rows[], fmi3ValueReference on[], size_t columns[], "
        "fmi3DependencyKind v[], size_t n",
        "GetFMUState": "fmi3FMUState *v",
        "SetFMUState": "fmi3FMUState v",
        "FreeFMUState": "fmi3FMUState *v",
        "SerializedFMUStateSize": "fmi3FMUState state, size_t *v",
        "SerializeFMUState": "fmi3FMUState state, fmi3Byte v[], size_t n",
        "DeserializeFMUState": "const fmi3Byte bytes[], size_t n, fmi3FMUState *v",
        "GetIntervalDecimal": f"{_R3}, fmi3Float64 v[], fmi3IntervalQualifier kinds[]",
        "GetIntervalFraction": f"{_R3}, fmi3UInt64 v[], fmi3UInt64 w[], fmi3IntervalQualifier kinds[]",
        "GetShiftDecimal": f"{_R3}, fmi3Float64 v[]",
        "GetShiftFraction": f"{_R3}, fmi3UInt64 v[], fmi3UInt64 w[]",
        "SetIntervalDecimal": f"{_R3}, const fmi3Float64 v[]",
        "SetIntervalFraction": f"{_R3}, const fmi3UInt64 v[], const fmi3UInt64 w[]",
        "SetShiftDecimal": f"{_R3}, const fmi3Float64 v[]",
        "SetShiftFraction": f"{_R3}, const fmi3UInt64 v[], const fmi3UInt64 w[]",
        "GetEventIndicators": "fmi3Float64 v[], size_t n",
        "EnterStepMode": "",
        "GetOutputDerivatives": f"{_R3}, const fmi3Int32 order[], fmi3Float64 v[], size_t m",
        "DoStep": "fmi3Float64 now, fmi3Float64 step, fmi3Boolean final, fmi3Boolean *event, fmi3Boolean *end, "
        "fmi3Boolean *early, fmi3Float64 *v",
        "ActivateModelPartition": "fmi3ValueReference r, fmi3Float64 v",
    }
    for direction in ("Directional", "Adjoint"):
        arguments[f"Get{direction}Derivative"] = (
            f"{_R3}, const fmi3ValueReference knowns[], size_t m, const fmi3Float64 seed[], size_t k, fmi3Float64 v[], size_t l"
        )
    empty = ("SetDebugLogging", "GetEventIndicators", "Float32", "Int", "Boolean", "String", "Binary", "Clock")
    kinds = {
        "InstantiateCoSimulation": "fmi3String name, fmi3String token, fmi3String place, fmi3Boolean visible, "
        "fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference r[], size_t n, "
        "fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update",
        "InstantiateScheduledExecution": "fmi3String name, fmi3String token, fmi3String place, fmi3Boolean visible, "
        "fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, "
        "fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock, fmi3UnlockPreemptionCallback unlock",
    }
    made = [f"fmi3Instance fmi3{name}({text})\n{{\n{_unused(text)}    return 0;\n}}" for name, text in kinds.items()]
    return "\n".join([*made, *_stubs("fmi3", "Instance", arguments, empty)])


def _stubs(standard: str, handle: str, functions: dict[str, str], empty: Sequence[str]) -> Iterator[str]:
    """A definition each; those whose name contains one of `empty` succeed if nothing at all is asked of them."""
    for name, arguments in functions.items():
        every = ", ".join(part for part in (f"{standard}{handle} c", arguments) if part)
        harmless = any(word in name for word in empty) and "size_t n" in arguments
        result = f"n ? {standard}Error : {standard}OK" if harmless and name != "SetDebugLogging" else f"{standard}Error"
        result = f"{standard}OK" if name == "SetDebugLogging" else result
        yield f"{standard}Status {standard}{name}({every})\n{{\n{_unused(every)}    return {result};\n}}"


def _unused(arguments: str) -> str:
    names = [part.replace("[]", "").split()[-1].lstrip("*") for part in arguments.split(",")]
    return "".join(f"    (void){name};\n" for name in names)
