"""The boundary model: one carrier for every face and edge, exact where it can be, proved where not.

`boundary` chooses and fits, each direction in one parametrisation and one spline space so that
neighbours agree; `deviation_proof` bounds what is left; `volume` does the same for M itself as
trivariate splines.
"""
