"""Stiffening by loads and rotation, and buckling."""

# Check before a march.
SAMPLED_TIMES = 401  # times of the motion at which loads and rates are looked at
# ∫ φ'² dx of a slender body's lowest modes is 1.2 (clamped) to 6 (hinged) times the largest φ² over its length.
SLOPES = 10.0
RINGING = 0.02  # Share of a motion that rings, where a change of frequency adds up to one of phase.
NEGLIGIBLE_TERMS = 1e-2  # Terms that change a stiffness by less than this part of the wanted error are left out.
# Error of a part that turns, over the change of its pieces' stiffness by their own inertia: 0.1 to 0.3 were measured.
OF_PIECES = 0.3
RIGID_LEAPFROGS = 1e6  # leapfrog steps of a march of rigid bodies
MOST_RADIANS = 1e6  # of its highest frequency that are followed
RIGID_IMPLICIT_STEPS = 4000  # of generalised-α beyond that
GROWTH = 3.0  # A deflection that grows by more than e³ has left what geometric stiffness describes.
CLOSED_BY_DEFORMING = 1e-6  # m or rad: a gap that bodies close by deforming, not one of round-off
SUSPECT = 0.5  # of its buckling load on a body alone: what loops or elements hold is looked at as a whole
MOMENTS = 41  # at which the stiffness of what loops or elements hold is looked at
