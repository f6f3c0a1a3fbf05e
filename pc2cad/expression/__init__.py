"""Expression trees over the reals: evaluation, derivatives, exact algebra and printing.

`Expr` is frozen and interned, so that equal trees are one object. Everything else reads it: NumPy
programs (`evaluation`), exact polynomial normal forms (`normal_form`), roots and quotients that
cancel (`simplification`), proofs that a tree is zero (`identity`, `rounded_identity`), what a term
is worth over the unit box (`magnitudes`), where a piecewise function changes its piece (`breaks`),
and SymPy, by a bridge.
"""
