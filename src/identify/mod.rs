//! From a recording to a valve model.
