//! Sets of nodes, a bit each.
