#include "anigen/metrics/chamfer.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/text.h"
#include "anigen/metrics/published_protocols.h"

namespace anigen::metrics {

namespace {

const Words<SkeletonProtocol> kProtocolNames = {{SkeletonProtocol::kPaper, "paper"},
                                                {SkeletonProtocol::kRignet, "rignet"},
                                                {SkeletonProtocol::kUnirig, "unirig"},
                                                {SkeletonProtocol::kPuppeteer, "puppeteer"}};

[[noreturn]] void refuse(const std::string& why) {
  throw InputError("", "skeleton", why + "; bring it into the unit box first");
}

constexpr int kLeaf = 4;
constexpr double kShortest = 1e-280;  // squared length whose inverse is still finite

double squared_distance_to_box(const Eigen::Vector3d& p, const Eigen::Vector3d& low, const Eigen::Vector3d& high) {
  return (low - p).cwiseMax(p - high).cwiseMax(0.0).squaredNorm();
}

double symmetric(double there, double back) { return 0.5 * (there + back); }

/// @param bones what distances to bones are measured to, of either side
SkeletonChamfer chamfer(const MetricSkeleton& a, const MetricSkeleton& b, const std::vector<BoneSamples>& samples_a,
                        const std::vector<BoneSamples>& samples_b, const NearestBone& bones_a,
                        const NearestBone& bones_b) {
  SkeletonChamfer result;
  result.j2j = symmetric(NearestBone::of_points(b.positions).mean_distance(a.positions),
                         NearestBone::of_points(a.positions).mean_distance(b.positions));
  result.j2b = symmetric(bones_b.mean_distance(a.positions), bones_a.mean_distance(b.positions));
  result.b2b = symmetric(bones_b.mean_distance(samples_a), bones_a.mean_distance(samples_b));
  return result;
}

SkeletonChamfer sampled(const MetricSkeleton& a, const MetricSkeleton& b, const std::vector<BoneSamples>& samples_a,
                        const std::vector<BoneSamples>& samples_b) {
  return chamfer(a, b, samples_a, samples_b, NearestBone(samples_a), NearestBone(samples_b));
}

}  // namespace

std::vector<BoneSamples> spaced_samples(const std::vector<geometry::Bone>& bones, double spacing) {
  std::vector<BoneSamples> all;
  all.reserve(bones.size());
  double total = 0;
  for (const geometry::Bone& bone : bones) {
    const Eigen::Vector3d along = bone.tail - bone.head;
    const double steps = std::nearbyint(along.norm() / spacing);  // half to even, the default rounding
    total += steps + 1;
    // Written so that an infinite length is refused too.
    if (!(total <= kMostBoneSamples)) refuse("its bones are too long to be sampled every 0.005");
    BoneSamples samples;
    samples.start = bone.head;
    samples.last = static_cast<std::int64_t>(steps);
    if (samples.last > 0) samples.step = along / steps;
    all.push_back(samples);
  }
  return all;
}

std::vector<BoneSamples> counted_samples(const std::vector<geometry::Bone>& bones, int count) {
  if (static_cast<double>(bones.size()) * count > kMostBoneSamples) refuse("it has too many bones to be sampled");
  std::vector<BoneSamples> all;
  all.reserve(bones.size());
  for (const geometry::Bone& bone : bones) all.push_back({bone.tail, (bone.head - bone.tail) / count, count - 1});
  return all;
}

std::int64_t sample_count(const std::vector<BoneSamples>& samples) {
  std::int64_t count = 0;
  for (const BoneSamples& bone : samples) count += bone.last + 1;
  return count;
}

NearestBone::NearestBone(const std::vector<geometry::Bone>& bones) {
  for (const geometry::Bone& bone : bones) add(bone.head, bone.tail - bone.head, 1.0);
  build();
}

NearestBone::NearestBone(const std::vector<BoneSamples>& samples) : rounded_(true) {
  for (const BoneSamples& bone : samples) add(bone.start, bone.step, static_cast<double>(bone.last));
  build();
}

NearestBone NearestBone::of_points(const std::vector<Eigen::Vector3d>& points) {
  return NearestBone(geometry::bones_of(points, std::vector<int>(points.size(), -1)));
}

void NearestBone::add(const Eigen::Vector3d& start, const Eigen::Vector3d& step, double last) {
  const double squared = step.squaredNorm();
  pieces_.push_back({start, step, squared > kShortest ? 1.0 / squared : 0.0, last});
}

void NearestBone::build() {
  if (pieces_.empty()) throw InputError("", "skeleton", "there is no bone to measure the distance to");
  // Median splits along the widest axis: halves differ by at most one, so the depth is that of log2 of the count.
  struct Task {
    int begin, end, parent;
  };
  std::vector<Task> tasks{{0, static_cast<int>(pieces_.size()), -1}};
  while (!tasks.empty()) {
    const Task task = tasks.back();
    tasks.pop_back();
    const int index = static_cast<int>(nodes_.size());
    if (task.parent >= 0) nodes_[at(task.parent)].right = index;
    Node node{Eigen::Vector3d::Constant(std::numeric_limits<double>::infinity()),
              Eigen::Vector3d::Constant(-std::numeric_limits<double>::infinity()), task.begin, task.end, -1};
    for (int i = task.begin; i < task.end; ++i) {
      const Piece& piece = pieces_[at(i)];
      const Eigen::Vector3d end = piece.start + piece.last * piece.step;
      node.low = node.low.cwiseMin(piece.start).cwiseMin(end);
      node.high = node.high.cwiseMax(piece.start).cwiseMax(end);
    }
    nodes_.push_back(node);
    if (task.end - task.begin <= kLeaf) continue;
    Eigen::Index axis = 0;
    (node.high - node.low).maxCoeff(&axis);
    const int middle = (task.begin + task.end) / 2;
    std::nth_element(pieces_.begin() + task.begin, pieces_.begin() + middle, pieces_.begin() + task.end,
                     [axis](const Piece& a, const Piece& b) {
                       return 2 * a.start[axis] + a.last * a.step[axis] < 2 * b.start[axis] + b.last * b.step[axis];
                     });
    // The second half first: the one popped next must become the node that follows this one.
    tasks.push_back({middle, task.end, index});
    tasks.push_back({task.begin, middle, -1});
  }
}

double NearestBone::squared_distance(const Piece& piece, const Eigen::Vector3d& p) const {
  double t = std::clamp((p - piece.start).dot(piece.step) * piece.inverse, 0.0, piece.last);
  if (rounded_) t = static_cast<double>(static_cast<std::int64_t>(t + 0.5));
  return (piece.start + t * piece.step - p).squaredNorm();
}

double NearestBone::distance(const Eigen::Vector3d& p) const {
  struct Entry {
    int node;
    double squared;
  };
  std::array<Entry, 64> stack;  // depth ≤ log2(2^31)
  std::size_t top = 0;
  double best = std::numeric_limits<double>::infinity();
  stack[top++] = {0, 0.0};
  while (top > 0) {
    const Entry entry = stack[--top];
    if (!(entry.squared < best)) continue;
    const Node& node = nodes_[at(entry.node)];
    if (node.right < 0) {
      for (int i = node.begin; i < node.end; ++i) best = std::min(best, squared_distance(pieces_[at(i)], p));
      continue;
    }
    const Node& first = nodes_[static_cast<std::size_t>(entry.node) + 1];
    const Node& second = nodes_[at(node.right)];
    Entry near{entry.node + 1, squared_distance_to_box(p, first.low, first.high)};
    Entry far{node.right, squared_distance_to_box(p, second.low, second.high)};
    if (far.squared < near.squared) std::swap(near, far);
    if (far.squared < best) stack[top++] = far;
    if (near.squared < best) stack[top++] = near;
  }
  return std::sqrt(best);
}

double NearestBone::mean_distance(const std::vector<Eigen::Vector3d>& points) const {
  double sum = 0;
  for (const Eigen::Vector3d& point : points) sum += distance(point);
  return sum / static_cast<double>(points.size());
}

double NearestBone::mean_distance(const std::vector<BoneSamples>& samples) const {
  double sum = 0;
  for (const BoneSamples& bone : samples) {
    for (std::int64_t i = 0; i <= bone.last; ++i) sum += distance(bone.point(i));
  }
  return sum / static_cast<double>(sample_count(samples));
}

std::string name(SkeletonProtocol protocol) { return word_of(kProtocolNames, protocol); }

SkeletonProtocol parse_skeleton_protocol(const std::string& text) { return value_of(kProtocolNames, text, "protocol"); }

SkeletonChamfer spaced_chamfer(const MetricSkeleton& predicted, const MetricSkeleton& truth) {
  return sampled(predicted, truth, spaced_samples(predicted.bones), spaced_samples(truth.bones));
}

SkeletonChamfer skeleton_chamfer(const MetricSkeleton& predicted, const MetricSkeleton& truth,
                                 SkeletonProtocol protocol, double unirig_range) {
  if (protocol == SkeletonProtocol::kPaper)
    return chamfer(predicted, truth, spaced_samples(predicted.bones), spaced_samples(truth.bones),
                   NearestBone(predicted.bones), NearestBone(truth.bones));
  if (protocol == SkeletonProtocol::kRignet) return spaced_chamfer(predicted, truth);
  if (protocol == SkeletonProtocol::kPuppeteer)
    return spaced_chamfer(puppeteer_cleaned(predicted), puppeteer_cleaned(truth));
  if (!(unirig_range > 0.0)) throw InputError("", "unirig_range", "the coordinate range must be positive");
  SkeletonChamfer result = sampled(predicted, truth, counted_samples(predicted.bones), counted_samples(truth.bones));
  result.j2j /= unirig_range;
  result.j2b /= unirig_range;
  result.b2b /= unirig_range;
  return result;
}

}  // namespace anigen::metrics
