#pragma once
#include <Eigen/Core>

#include "anigen/core/random.h"

namespace anigen::creatures {

/// Paint of a part of a creature. Colours are linear RGB.
struct Paint {
  enum class Pattern { kPlain, kStripes, kBands, kSpots, kMottled, kEye, kPanels };
  Pattern pattern = Pattern::kPlain;
  Eigen::Vector3d base = Eigen::Vector3d::Constant(0.5);
  Eigen::Vector3d under = Eigen::Vector3d::Constant(0.5);  ///< colour of surfaces that face `down`
  Eigen::Vector3d accent = Eigen::Vector3d::Zero();        ///< of stripes, spots; the pupil of an eye
  Eigen::Vector3d down = -Eigen::Vector3d::UnitZ();        ///< belly direction in the plan frame; zero: no gradient
  Eigen::Vector3d along = Eigen::Vector3d::UnitY();        ///< across the stripes
  double frequency = 8.0;                                  ///< stripes or spots per unit length of the plan
  double strength = 0.8;                                   ///< 0: no pattern
  double phase = 0.0;
};

/// Colour at a point of the plan frame with the given normal there.
/// @param center, look of the eye the point belongs to, for kEye only
Eigen::Vector3d paint_color(const Paint& paint, const Eigen::Vector3d& x, const Eigen::Vector3d& normal,
                            const Eigen::Vector3d& center, const Eigen::Vector3d& look);

/// Linear RGB of hue (in turns), saturation and value (of the sRGB colour), all in [0, 1].
Eigen::Vector3d color_of(double hue, double saturation, double value);

/// An animal's coat: base, belly and pattern that go together.
/// @param size length of the body, to which the pattern is scaled
Paint random_coat(Rng& rng, double size, const Eigen::Vector3d& along);
Paint plain(const Eigen::Vector3d& color);
/// A shade of another paint without its pattern.
Paint shade(const Paint& paint, double factor);
Paint eye_paint(Rng& rng);
/// Painted, bare or anodised metal, or plastic.
Paint machine_paint(Rng& rng, bool bright);

}  // namespace anigen::creatures
