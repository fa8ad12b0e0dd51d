//! motion_board
