//! One definition per figure, with its id and source.
