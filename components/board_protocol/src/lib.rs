//! The framed protocol between the motion-board driver and the board, real or simulated.
