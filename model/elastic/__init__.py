"""Linear elasticity on the staggered grid."""
