// Colours of the pictures: for lines and bars, and a sequential map for values.
#pragma once

#include <cstddef>

namespace teres::tools {

struct Color {
    double r = 0.0, g = 0.0, b = 0.0;  ///< 0..255
};
inline constexpr Color kInk{35, 35, 40}, kPale{205, 208, 214}, kPaper{255, 255, 255}, kGrid{232, 234, 238};

/// Distinguishable also by colour-blind readers (Okabe and Ito, 2008); wraps around.
Color palette(std::size_t index);
/// From pale yellow (0) over teal to dark blue (1); monotone in lightness, so it survives a grey print. NaN
/// is grey.
Color sequential(double value);

}  // namespace teres::tools
