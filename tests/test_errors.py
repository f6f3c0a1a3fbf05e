"""Exit codes are a public contract of the error classes."""

from pc2cad import errors


def test_each_error_carries_the_exit_code_of_its_kind() -> None:
    assert errors.InputError.exit_code == 2
    assert errors.NotASolidError.exit_code == 3
    assert errors.ToleranceNotReachedError.exit_code == 4
    assert errors.KernelError.exit_code == errors.FileNotWrittenError.exit_code == 5
