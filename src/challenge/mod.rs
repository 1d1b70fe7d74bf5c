//! A finer plant that conceals an effect, to prove the diagnosis on.
