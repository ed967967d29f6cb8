"""Statistics that know no mount: columns, weights, solvers, their result."""
