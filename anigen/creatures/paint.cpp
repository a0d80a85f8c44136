#include "anigen/creatures/paint.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "anigen/core/numeric.h"

namespace anigen::creatures {

namespace {

using Eigen::Vector3d;

double smoothstep(double low, double high, double x) {
  const double t = std::clamp((x - low) / (high - low), 0.0, 1.0);
  return t * t * (3.0 - 2.0 * t);
}

/// A uniform number in [0, 1) for a lattice point.
double lattice(std::int64_t x, std::int64_t y, std::int64_t z) {
  auto h = static_cast<std::uint64_t>(x) * 0x8DA6B343ull + static_cast<std::uint64_t>(y) * 0xD8163841ull +
           static_cast<std::uint64_t>(z) * 0xCB1AB31Full;
  h = (h ^ (h >> 33)) * 0xFF51AFD7ED558CCDull;
  h = (h ^ (h >> 33)) * 0xC4CEB9FE1A85EC53ull;
  return static_cast<double>((h ^ (h >> 33)) >> 11) * 0x1.0p-53;
}

/// Smooth noise in [0, 1], features of unit size.
double noise(const Vector3d& x) {
  const Vector3d cell = x.array().floor();
  const Vector3d f = x - cell;
  const Vector3d t = f.array() * f.array() * (3.0 - 2.0 * f.array());
  double sum = 0.0;
  for (int corner = 0; corner < 8; ++corner) {
    const int i = corner & 1, j = (corner >> 1) & 1, k = corner >> 2;
    const double weight = (i ? t.x() : 1 - t.x()) * (j ? t.y() : 1 - t.y()) * (k ? t.z() : 1 - t.z());
    sum += weight * lattice(static_cast<std::int64_t>(cell.x()) + i, static_cast<std::int64_t>(cell.y()) + j,
                            static_cast<std::int64_t>(cell.z()) + k);
  }
  return sum;
}

/// Distance to the nearest of the points scattered one per unit cell.
double nearest_spot(const Vector3d& x) {
  const Vector3d cell = x.array().floor();
  double best = 9.0;
  for (int n = 0; n < 27; ++n) {
    const Vector3d c = cell + Vector3d(n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1);
    const auto i = static_cast<std::int64_t>(c.x()), j = static_cast<std::int64_t>(c.y()),
               k = static_cast<std::int64_t>(c.z());
    const Vector3d point = c + Vector3d(lattice(i, j, k), lattice(i + 71, j, k), lattice(i, j + 71, k));
    best = std::min(best, (x - point).squaredNorm());
  }
  return std::sqrt(best);
}

Vector3d mix(const Vector3d& a, const Vector3d& b, double t) { return a + (b - a) * std::clamp(t, 0.0, 1.0); }

}  // namespace

Vector3d paint_color(const Paint& paint, const Vector3d& x, const Vector3d& normal, const Vector3d& center,
                     const Vector3d& look) {
  if (paint.pattern == Paint::Pattern::kEye) {
    const double facing = (x - center).normalized().dot(look);
    if (facing > 0.66) return paint.accent;
    return facing > 0.4 ? paint.base : paint.under;
  }
  const double belly = paint.down.isZero() ? 0.0 : smoothstep(0.05, 0.75, normal.dot(paint.down));
  const Vector3d at = x * paint.frequency + Vector3d::Constant(paint.phase);
  double pattern = 0.0;
  switch (paint.pattern) {
    case Paint::Pattern::kStripes: {
      const double wobble = 1.6 * noise(0.8 * at);
      pattern = smoothstep(0.35, 0.65, 0.5 + 0.5 * std::sin(2.0 * kPi * (at.dot(paint.along) + wobble)) - 0.1);
      break;
    }
    case Paint::Pattern::kBands:
      pattern = smoothstep(0.4, 0.6, 0.5 + 0.5 * std::sin(2.0 * kPi * at.dot(paint.along)));
      break;
    case Paint::Pattern::kSpots:
      pattern = 1.0 - smoothstep(0.28, 0.42, nearest_spot(at));
      break;
    case Paint::Pattern::kMottled:
      pattern = 0.7 * noise(at) + 0.3 * noise(2.3 * at);
      break;
    case Paint::Pattern::kPanels:
      pattern = std::abs(at.dot(paint.along) - std::round(at.dot(paint.along))) < 0.08 ? 1.0 : 0.0;
      break;
    case Paint::Pattern::kPlain:
    case Paint::Pattern::kEye:
      break;
  }
  const Vector3d coat = mix(paint.base, paint.accent, paint.strength * pattern * (1.0 - 0.8 * belly));
  return mix(coat, paint.under, belly).cwiseMax(0.0).cwiseMin(1.0);
}

Vector3d color_of(double hue, double saturation, double value) {
  const auto channel = [&](double shift) {
    const double turn = hue + shift - std::floor(hue + shift);
    const double ramp = std::clamp(std::abs(turn * 6.0 - 3.0) - 1.0, 0.0, 1.0);
    const double srgb = value * (1.0 - saturation + saturation * ramp);
    return srgb <= 0.04045 ? srgb / 12.92 : std::pow((srgb + 0.055) / 1.055, 2.4);
  };
  return {channel(0.0), channel(2.0 / 3.0), channel(1.0 / 3.0)};
}

Paint plain(const Vector3d& color) {
  Paint paint;
  paint.base = paint.under = paint.accent = color;
  paint.down = Vector3d::Zero();
  return paint;
}

Paint shade(const Paint& paint, double factor) {
  Paint result = paint;
  result.pattern = Paint::Pattern::kPlain;
  for (Vector3d* color : {&result.base, &result.under, &result.accent}) *color = (*color * factor).cwiseMin(1.0);
  return result;
}

Paint random_coat(Rng& rng, double size, const Vector3d& along) {
  Paint paint;
  // Half of the animals wear natural colours (browns, greys, sands), half are as bright as toys.
  const bool natural = rng.chance(0.5);
  const double hue = natural ? rng.uniform(0.04, 0.13) : rng.uniform();
  const double saturation = natural ? rng.uniform(0.15, 0.6) : rng.uniform(0.45, 0.85);
  const double value = natural ? rng.uniform(0.35, 0.9) : rng.uniform(0.55, 0.95);
  paint.base = color_of(hue, saturation, value);
  paint.under = color_of(hue + rng.uniform(-0.04, 0.04), 0.4 * saturation, std::min(1.0, value + 0.3));
  const bool darker = value > 0.55 || rng.chance(0.5);
  paint.accent =
      color_of(hue + rng.uniform(-0.12, 0.12), saturation, darker ? 0.35 * value : std::min(1.0, 1.6 * value));
  constexpr Paint::Pattern kPatterns[] = {Paint::Pattern::kPlain, Paint::Pattern::kStripes, Paint::Pattern::kSpots,
                                          Paint::Pattern::kMottled, Paint::Pattern::kBands};
  paint.pattern = kPatterns[rng.index(5)];
  paint.strength = rng.uniform(0.55, 0.95);
  paint.frequency = rng.uniform(5.0, 9.0) / size;
  paint.phase = rng.uniform(0.0, 50.0);
  paint.along = along;
  return paint;
}

Paint eye_paint(Rng& rng) {
  Paint paint;
  paint.pattern = Paint::Pattern::kEye;
  paint.under = color_of(0.12, 0.05, 0.97);
  paint.base = color_of(rng.uniform(), 0.7, rng.uniform(0.4, 0.8));
  paint.accent = Vector3d::Constant(0.01);
  return paint;
}

Paint machine_paint(Rng& rng, bool bright) {
  // Bright machines are yellow to orange-red or green to blue, never pink.
  const double hue = rng.uniform(-0.03, 0.68);
  Paint paint = plain(bright ? color_of(hue, rng.uniform(0.6, 0.88), rng.uniform(0.65, 0.92))
                             : color_of(rng.uniform(0.5, 0.7), rng.uniform(0.0, 0.12), rng.uniform(0.18, 0.85)));
  return paint;
}

}  // namespace anigen::creatures
