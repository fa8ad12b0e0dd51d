//! Communication objects of the navigation robot.
