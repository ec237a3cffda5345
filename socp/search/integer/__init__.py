"""Words chosen by binaries: the mixed-binary reduction and the solvers that take it."""
