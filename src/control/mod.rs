//! Feed-forward, PI, the controller, and the stability of the loop that it closes.
