"""Memory layout of eight cone programs that are solved at once.

A lane is one program. Every quantity is a row of 8 numbers, one per lane, so that each inner loop is one vector
instruction: all lanes share the matrix of the contact set and differ in direction only.

Two arrays hold everything. The block of contact i begins at `BLOCK * i` of the cone array `w`, its rows at the offsets
`S` .. `COLUMNS`. The array `g` holds what belongs to a program as a whole. Offsets pass through `& MASK`, which shows
the compiler that they are not negative: without that the loops are not vectorised (a factor of three).
"""

LANES = 8
MASK = 0xFFFFFF
MAX_UNKNOWNS = 6

# rows of a contact in w, three for a vector of the cone's space
S, X, SCALED, RHS, RHS_S, RES, TARGET, FIRST, SECOND, STEP = (24 * row for row in range(10))
# dual slack, primal force, scaled point, right-hand side, the same scaled, dual residual (scaled in place),
# right-hand side of complementarity, the two parts of the primal step, the step
AXIS, ETA, I_ETA, I_W0 = 240, 264, 272, 280  # Nesterov-Todd scaling point (unit), its length, 1 / ETA, 1 / (1 + w0)
COLUMNS = 288  # scaled columns of the matrix, 3 rows for each unknown
BLOCK = COLUMNS + 24 * MAX_UNKNOWNS

# rows of g
TAU, KAPPA, GAP, MU, D_TAU, D_KAPPA, REACH, SIGMA, DEN, NUM, ACTIVE, DUAL_RES, PRIMAL_RES, COST, GAIN, LENGTH = (
    8 * row for row in range(16)
)
LAMBDA, RESIDUAL, P1, P2, MATRIX = (128 + 48 * row for row in range(5))  # MATRIX: lower triangle, row by row
SIZE = MATRIX + 8 * (MAX_UNKNOWNS * (MAX_UNKNOWNS + 1) // 2)

PIVOT = 1e-15  # of the largest diagonal entry; below it the direction is left alone
