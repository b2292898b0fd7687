"""The processor that the code runs on, and the compiler for it."""

from __future__ import annotations

from functools import cache
from typing import Any

from llvmlite import binding


class Processor:
    """This machine's processor.

    Attributes:
        lanes: the numbers that it works on at once.

    Raises:
        OSError: no code may be made while a program runs.
    """

    def __init__(self) -> None:
        binding.check_jit_execution()
        binding.initialize_native_target()
        binding.initialize_native_asmprinter()
        self._name, features = binding.get_host_cpu_name(), binding.get_host_cpu_features()
        self.lanes = 8 if features.get("avx512f") else 4
        self._features = features.flatten()

    def compile(self, assembly: str) -> Any:
        """Machine code, which lives as long as what is returned; its ``get_function_address`` finds functions."""
        # The code owns its target: each needs one of its own.
        target = binding.Target.from_default_triple().create_target_machine(
            cpu=self._name, features=self._features, opt=2, jit=True
        )
        code = binding.create_mcjit_compiler(binding.parse_assembly(assembly), target)
        code.finalize_object()
        return code


@cache
def processor() -> Processor:
    """The one that there is."""
    return Processor()
