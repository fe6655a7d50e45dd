# pyright: basic, reportPrivateUsage=false, reportAttributeAccessIssue=false
"""Faster compilation of kernels with numba: each function is optimised and turned into machine code only once.

numba makes a library of every function it compiles, optimises it, emits machine code with a wrapper for Python, and
then links the library into every caller, where all of that is done again. Here a function is lowered once to LLVM code
for linking; only a function that Python calls (an entry) becomes machine code, together with everything it calls.
Constant arguments of a call from another kernel do not make a specialisation of their own.

An import of this module changes numba for the whole process: the code of every function that is compiled afterwards is
a `Library`, and the error of an assignment to a slice of another shape does not name the two shapes.
"""

from copy import copy
from typing import Any

import llvmlite.binding as llvm
import numba.core.dispatcher  # noqa: F401 - registers what codegen needs
from numba.core import config, types
from numba.core.codegen import JITCodeLibrary, JITCPUCodegen
from numba.core.environment import Environment, lookup_environment
from numba.core.registry import CPUDispatcher
from numba.np import arrayobj

from surefoot.kernels.kept import KeptCache, KeptImpl

ENVIRONMENT = "_ZN08NumbaEnv"
"""Prefix of the names of variables that hold the Python objects of a compiled function."""
DYNAMIC = "numba.dynamic.globals"
"""Prefix of the names of variables that hold addresses of one process; code with such a variable is not cached."""


class Library(JITCodeLibrary):
    """Code of one function, which becomes machine code only when the address of its Python wrapper is requested."""

    vectors = True
    """True if loops may become vector code, if numba's setting `LOOP_VECTORIZE` allows it; False: they do not, as the
    search for such loops takes a third of the time of a large function."""

    def add_linking_library(self, library: Any) -> None:
        """Add the library of a called function, which need not have machine code of its own."""
        self._linking_libraries.append(library)

    def _optimize_functions(self, ll_module: Any) -> None:
        """Run LLVM's function passes on each function of a module; the passes are prepared once and reused."""
        ll_module.data_layout = self._codegen._data_layout
        passes, builder = self._codegen._function_pass_manager()
        for function in ll_module.functions:
            if not function.is_declaration:
                passes.run(function, builder)

    def _optimize_final_module(self) -> None:
        """Run LLVM's passes on the module: quick ones that inline, so that reference counts are pruned, then all."""
        for options in (
            {"opt": 0, "cost": "cheap", "loop_vectorize": False, "slp_vectorize": False},
            {"loop_vectorize": self.vectors and bool(config.LOOP_VECTORIZE)},
        ):
            passes, builder = self._codegen._module_pass_manager(**options)
            passes.run(self._final_module, builder)

    def _get_module_for_linking(self) -> Any:
        """Return the code with that of all callees, as a module that may be linked into several others."""
        if self._shared_module is None:
            module = self._final_module.clone()
            module.name = self._final_module.name
            for library in dict.fromkeys(self._linking_libraries):
                self._reload_init.update(library._reload_init)
                module.link_in(library._get_module_for_linking(), preserve=True)
            for function in module.functions:
                if not function.is_declaration and function.linkage == llvm.Linkage.external:
                    function.linkage = "linkonce_odr"
            self._shared_module = module
        return self._shared_module

    def get_pointer_to_function(self, name: str) -> int:
        """Return the address of the wrapper `name`; 0 for code without one, for which no machine code is made."""
        if not self._finalized:
            try:
                self._final_module.get_function(name)
            except NameError:
                return 0
        return super().get_pointer_to_function(name)

    def _finalize_specific(self) -> None:
        """Emit machine code, and give it the Python objects of all functions that went into it."""
        super()._finalize_specific()
        for variable in self._final_module.global_variables:
            environment = lookup_environment(variable.name) if variable.name.startswith(ENVIRONMENT) else None
            if environment is not None:
                self._codegen.set_env(variable.name, environment)

    @property
    def has_dynamic_globals(self) -> bool:
        """Return whether the code contains addresses that are valid in this process only and so cannot be cached."""
        module = self._final_module if self._finalized else self._get_module_for_linking()
        return any(variable.name.startswith(DYNAMIC) for variable in module.global_variables)

    def serialize_using_object_code(self) -> tuple[str, str, Any]:
        """Return the state to store in the cache: name, kind, and machine code with its symbols, or LLVM bitcode."""
        if not self._finalized:
            return self.name, "link", self._get_module_for_linking().as_bitcode()
        symbols = (*self._final_module.functions, *self._final_module.global_variables)
        return self.name, "emitted", (self._get_compiled_object(), [s.name for s in symbols if not s.is_declaration])

    @classmethod
    def _unserialize(cls, codegen: Any, state: tuple[str, str, Any]) -> Any:
        name, kind, data = state
        if kind not in ("link", "emitted"):
            return super()._unserialize(codegen, state)
        self = codegen.create_library(name)
        if kind == "link":
            self._final_module = self._shared_module = llvm.parse_bitcode(data)
        else:
            self.enable_object_caching()
            self._set_compiled_object(data[0])
            codegen._engine._defined_symbols.update(data[1])
            self._finalize_final_module()
        return self


class _LinkedImpl(KeptImpl):
    """Storage in the cache of the code of kernels that other kernels link, in files beside those of machine code."""

    def get_filename_base(self, fullname: str, abiflags: str) -> str:
        return super().get_filename_base(fullname, abiflags) + ".link"

    def reduce(self, cres: Any) -> tuple[Any, ...]:
        """Return the parts of a compilation that the cache stores, with the Python objects of all called functions."""
        *kept, _own = super().reduce(cres)
        names = [variable.name for variable in cres.library._get_module_for_linking().global_variables]
        found = [lookup_environment(name) for name in names if name.startswith(ENVIRONMENT)]
        return *kept, tuple(each for each in found if each is not None and each.can_cache())


class _LinkedCache(KeptCache):
    _impl_class = _LinkedImpl


class Linked(CPUDispatcher):
    """A kernel in the form that other kernels call: LLVM code without Python wrapper or own machine code."""

    def enable_caching(self) -> None:
        self._cache = _LinkedCache(self.py_func)


class _Entries:
    """Compiler that wraps a linked function for calls from Python; all else is left to numba's own compiler."""

    def __init__(self, kernel: Any, compiler: Any) -> None:
        self._kernel, self._compiler = kernel, compiler

    def __getattr__(self, name: str) -> Any:
        return getattr(self._compiler, name)

    def compile(self, args: tuple[Any, ...], return_type: Any) -> Any:
        linked = self._kernel.linked
        linked.compile(tuple(args))
        inner = linked.overloads[tuple(args)]
        context = self._kernel.targetctx.subtarget(enable_nrt=True)
        library = context.codegen().create_library(inner.fndesc.qualname)
        library.vectors = self._kernel.vectors
        library.enable_object_caching()
        unlocked = self._kernel.targetoptions.get("nogil", False)
        wrapped = copy(inner.fndesc)
        wrapped.env_name += "_entry"  # Python objects of the wrapper, kept apart: linked code is kept without them
        environment = Environment.from_fndesc(wrapped)
        context.create_cpython_wrapper(library, wrapped, environment, None, unlocked)
        library.add_linking_library(inner.library)
        entry = context.get_executable(library, wrapped, environment)
        return inner._replace(library=library, fndesc=wrapped, environment=environment, entry_point=entry, metadata={})


class Kernel(CPUDispatcher):
    """A compiled function that Python calls; other kernels call `linked`, the form of it that is linked."""

    vectors = True
    """True if loops of the kernel may become vector code, if numba's setting `LOOP_VECTORIZE` allows it; False: they do
    not."""

    def __init__(self, py_func: Any, locals: Any = None, targetoptions: Any = None, **others: Any) -> None:
        super().__init__(py_func, locals, targetoptions, **others)
        bare = dict(targetoptions or {}, no_cpython_wrapper=True, no_cfunc_wrapper=True)
        self.linked = Linked(py_func, locals, bare, **others)
        self._compiler = _Entries(self, self._compiler)
        self._aside: dict[tuple[Any, ...], Any] = {}

    def enable_caching(self) -> None:
        self._cache = KeptCache(self.py_func)
        self.linked.enable_caching()

    def cache_files(self) -> tuple[Any, ...]:
        """Return the index files of this kernel's compiled code in the cache on disk."""
        return *self._cache.files, *self.linked._cache.files

    def set_aside(self) -> None:
        """Clear the list of signatures in use; one that is called again is taken from memory, not compiled."""
        self._aside |= self.overloads
        self._reset_overloads()

    def compile(self, sig: Any) -> Any:
        """Return the address to call for argument types `sig`: of code in memory, from the cache, or compiled now."""
        kept = self._aside.get(sig) if isinstance(sig, tuple) else None
        if kept is None or sig in self.overloads:
            return super().compile(sig)
        self.add_overload(kept)
        return kept.entry_point

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return numba's template of a call from another kernel, constants as variables; args, kws: types."""
        plain = {name: types.unliteral(value) for name, value in kws.items()}
        return self.linked.get_call_template(tuple(types.unliteral(value) for value in args), plain)

    def get_overload(self, sig: Any) -> Any:
        return self.linked.get_overload(sig)


def _set_env(codegen: Any, name: str, environment: Any, original: Any = JITCPUCodegen.set_env) -> None:
    """Set the Python objects of a function that is machine code; code to link gets them when it is emitted."""
    if codegen._engine.is_symbol_defined(name):
        original(codegen, name, environment)


# A slice that gets another shape is refused without the two shapes: their text costs each process 3 s of the compiler,
# and each kernel that assigns to a slice the code that makes it.
arrayobj.ol_raise_with_shape_context_cpu.__code__ = arrayobj.ol_raise_with_shape_context_generic.__code__
JITCPUCodegen._library_class = Library
JITCPUCodegen.set_env = _set_env
