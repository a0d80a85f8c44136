#include "anigen/eval/skeleton/bone_samples.h"

#include <cmath>

#include "anigen/core/error.h"

namespace anigen::eval {
namespace {

[[noreturn]] void refuse(const std::string& why) {
  throw InputError("", "skeleton", why + "; bring it into the unit box first");
}

}  // namespace

std::vector<BoneSamples> spaced_samples(const std::vector<BoneLine>& lines, double spacing) {
  std::vector<BoneSamples> all;
  all.reserve(lines.size());
  double total = 0;
  for (const BoneLine& line : lines) {
    const Eigen::Vector3d along = line.tail - line.head;
    const double steps = std::nearbyint(along.norm() / spacing);  // half to even, the default rounding
    total += steps + 1;
    // Written so that an infinite length is refused too.
    if (!(total <= kMostBoneSamples)) refuse("its bones are too long to be sampled every 0.005");
    BoneSamples samples;
    samples.start = line.head;
    samples.last = static_cast<std::int64_t>(steps);
    if (samples.last > 0) samples.step = along / steps;
    all.push_back(samples);
  }
  return all;
}

std::vector<BoneSamples> counted_samples(const std::vector<BoneLine>& lines, int count) {
  if (static_cast<double>(lines.size()) * count > kMostBoneSamples) refuse("it has too many bones to be sampled");
  std::vector<BoneSamples> all;
  all.reserve(lines.size());
  for (const BoneLine& line : lines) all.push_back({line.tail, (line.head - line.tail) / count, count - 1});
  return all;
}

std::int64_t sample_count(const std::vector<BoneSamples>& samples) {
  std::int64_t count = 0;
  for (const BoneSamples& bone : samples) count += bone.last + 1;
  return count;
}

std::vector<Eigen::Vector3d> sample_points(const std::vector<BoneSamples>& samples) {
  std::vector<Eigen::Vector3d> points;
  points.reserve(static_cast<std::size_t>(sample_count(samples)));
  for (const BoneSamples& bone : samples) {
    for (std::int64_t i = 0; i <= bone.last; ++i) points.push_back(bone.point(i));
  }
  return points;
}

}  // namespace anigen::eval
