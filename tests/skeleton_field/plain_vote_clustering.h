#pragma once
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include "anigen/skeleton_field/voting.h"

namespace anigen::test {

/// The grouping of votes written down plainly: every vote is compared with every other one, in index order. Slow and
/// obvious, to test and time skeleton_field/voting.h against, whose results must equal these bit for bit.
class PlainVoteClustering {
 public:
  static skeleton_field::GroupedSkeleton mean_shift(const skeleton_field::Votes& all,
                                                    const skeleton_field::MeanShiftOptions& options) {
    const skeleton_field::Votes votes = confident(all, options.confidence_threshold);
    if (votes.joints.empty()) return nothing_confident(all);
    std::vector<Eigen::Vector3f> positions = votes.joints;
    const bool paper = options.form == skeleton_field::MeanShiftForm::kPaper;
    for (int round = 0; round < (paper ? 10 : options.max_iterations); ++round) {
      const std::vector<Eigen::Vector3f> before = positions;
      float farthest = 0.0F;
      for (std::size_t i = 0; i < before.size(); ++i) {
        positions[i] = paper ? mean_within(before, votes.joint_confidence, i, options.bandwidth)
                             : shifted(before, votes.joint_confidence, i, options);
        farthest = std::max(farthest, std::sqrt(squared(positions[i], before[i])));
      }
      if (farthest <= 0.1F * options.bandwidth) break;
    }
    std::vector<int> labels(positions.size(), -1);
    int count = 0;
    for (std::size_t i = 0; i < positions.size(); ++i) {
      if (labels[i] >= 0) continue;
      for (std::size_t k = 0; k < positions.size(); ++k) {
        if (std::sqrt(squared(positions[k], positions[i])) <= 0.5F * options.bandwidth) labels[k] = count;
      }
      ++count;
    }
    return skeleton(votes, labels, count, options.min_cluster_size);
  }

  static skeleton_field::GroupedSkeleton threshold(const skeleton_field::Votes& all,
                                                   const skeleton_field::ThresholdOptions& options) {
    const skeleton_field::Votes votes = confident(all, options.confidence_threshold);
    const std::size_t size = votes.joints.size();
    std::vector<std::size_t> parent(size);
    std::vector<int> rank(size, 0);
    for (std::size_t i = 0; i < size; ++i) parent[i] = i;
    const auto root = [&](std::size_t i) {
      while (parent[i] != i) i = parent[i];
      return i;
    };
    const auto most = static_cast<std::size_t>(options.max_neighbours);
    for (std::size_t i = 0; i < size; ++i) {
      for (const std::size_t k : neighbours(votes.joints, i, most, options.distance)) {
        const std::size_t a = root(i), b = root(k);
        if (a == b) continue;
        if (rank[a] < rank[b]) {
          parent[a] = b;
        } else {
          parent[b] = a;
          if (rank[a] == rank[b]) ++rank[a];
        }
      }
    }
    std::vector<int> labels(size, -1);
    int count = 0;
    for (std::size_t i = 0; i < size; ++i) {
      if (root(i) == i) labels[i] = count++;
    }
    for (std::size_t i = 0; i < size; ++i) labels[i] = labels[root(i)];
    return skeleton(votes, labels, count, 0);
  }

 private:
  static float squared(const Eigen::Vector3f& a, const Eigen::Vector3f& b) {
    const float x = a.x() - b.x(), y = a.y() - b.y(), z = a.z() - b.z();
    return x * x + y * y + z * z;
  }

  static skeleton_field::Votes confident(const skeleton_field::Votes& all, float threshold) {
    skeleton_field::Votes votes;
    for (std::size_t i = 0; i < all.joints.size(); ++i) {
      const float joint = all.joint_confidence.empty() ? 1.0F : all.joint_confidence[i];
      const float parent = all.parent_confidence.empty() ? 1.0F : all.parent_confidence[i];
      if (joint < threshold || parent < threshold) continue;
      votes.joints.push_back(all.joints[i]);
      votes.parents.push_back(all.parents[i]);
      votes.joint_confidence.push_back(joint);
      votes.parent_confidence.push_back(parent);
    }
    return votes;
  }

  static skeleton_field::GroupedSkeleton nothing_confident(const skeleton_field::Votes& all) {
    skeleton_field::GroupedSkeleton skeleton;
    if (all.joints.empty()) return skeleton;
    skeleton.joints.emplace_back(Eigen::Vector3f::Zero());
    skeleton.parents.push_back(0);
    return skeleton;
  }

  /// The first `most` + 1 within the radius, without the first of them.
  static std::vector<std::size_t> neighbours(const std::vector<Eigen::Vector3f>& positions, std::size_t i,
                                             std::size_t most, float radius) {
    std::vector<std::size_t> found;
    for (std::size_t k = 0; k < positions.size() && found.size() <= most; ++k) {
      if (squared(positions[k], positions[i]) < radius * radius) found.push_back(k);
    }
    if (!found.empty()) found.erase(found.begin());
    return found;
  }

  static Eigen::Vector3f shifted(const std::vector<Eigen::Vector3f>& positions, const std::vector<float>& confidence,
                                 std::size_t i, const skeleton_field::MeanShiftOptions& options) {
    const float falloff = 0.5F / (options.bandwidth * options.bandwidth);
    float total = 0.0F;
    Eigen::Vector3f sum = Eigen::Vector3f::Zero();
    const auto most = static_cast<std::size_t>(options.max_neighbours);
    for (const std::size_t k : neighbours(positions, i, most, options.bandwidth)) {
      const float weight = confidence[k] * std::exp(-squared(positions[k], positions[i]) * falloff);
      total += weight;
      sum += weight * positions[k];
    }
    return total > 0.0F ? Eigen::Vector3f(sum / (total + 1e-8F)) : positions[i];
  }

  static Eigen::Vector3f mean_within(const std::vector<Eigen::Vector3f>& positions,
                                     const std::vector<float>& confidence, std::size_t i, float radius) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    double total = 0.0;
    for (std::size_t k = 0; k < positions.size(); ++k) {
      if (std::sqrt(squared(positions[k], positions[i])) > radius) continue;
      sum += static_cast<double>(confidence[k]) * positions[k].cast<double>();
      total += static_cast<double>(confidence[k]);
    }
    return (sum / total).cast<float>();
  }

  static Eigen::Vector3f mean(const std::vector<Eigen::Vector3f>& positions, const std::vector<float>& confidence,
                              const std::vector<int>& labels, int label) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    double weight = 0.0;
    for (std::size_t i = 0; i < positions.size(); ++i) {
      if (labels[i] != label) continue;
      sum += static_cast<double>(confidence[i]) * positions[i].cast<double>();
      weight += static_cast<double>(confidence[i]);
    }
    return Eigen::Vector3d(sum / (weight + 1e-8)).cast<float>();
  }

  static skeleton_field::GroupedSkeleton skeleton(const skeleton_field::Votes& votes, const std::vector<int>& labels,
                                                  int count, int min_size) {
    std::vector<int> kept;
    for (const bool all : {false, true}) {
      for (int label = 0; label < count; ++label) {
        const auto size = std::count(labels.begin(), labels.end(), label);
        if (all || size >= min_size) kept.push_back(label);
      }
      if (!kept.empty()) break;
    }
    skeleton_field::GroupedSkeleton result;
    for (const int label : kept) result.joints.push_back(mean(votes.joints, votes.joint_confidence, labels, label));
    for (std::size_t j = 0; j < kept.size(); ++j) {
      const Eigen::Vector3d parent = mean(votes.parents, votes.parent_confidence, labels, kept[j]).cast<double>();
      std::size_t nearest = 0;
      double best = std::numeric_limits<double>::infinity();
      for (std::size_t k = 0; k < kept.size(); ++k) {
        const double distance = (result.joints[k].cast<double>() - parent).squaredNorm();
        if (distance < best) {
          best = distance;
          nearest = k;
        }
      }
      result.parents.push_back(nearest == j ? -1 : static_cast<int>(nearest));
    }
    return result;
  }
};

}  // namespace anigen::test
