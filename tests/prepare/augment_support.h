#pragma once
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <cstring>
#include <utility>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/prepare/pose_augmentation.h"

// A small asset to pose, and looking at what became of it.
namespace anigen::prepare {

inline constexpr double kRadians = EIGEN_PI / 180.0;

/// A closed square tube of 13 rings along x from -0.5 to 0.5 on a chain of `joints` joints; weights go over linearly
/// from joint to joint. Longest side 1.
inline Asset tube(std::size_t joints) {
  Asset asset;
  asset.name = "tube";
  constexpr int kRings = 13;
  std::vector<Eigen::Vector3d> positions;
  std::vector<int> parents;
  for (std::size_t j = 0; j < joints; ++j) {
    positions.emplace_back(-0.5 + static_cast<double>(j) / static_cast<double>(joints), 0.0, 0.0);
    parents.push_back(static_cast<int>(j) - 1);
  }
  asset.skeleton = skeleton_from_joints(positions, parents);
  for (int ring = 0; ring < kRings; ++ring) {
    const float x = static_cast<float>(ring) / (kRings - 1) - 0.5f;
    for (const auto& [y, z] : {std::pair{-1.0f, -1.0f}, {1.0f, -1.0f}, {1.0f, 1.0f}, {-1.0f, 1.0f}}) {
      asset.mesh.vertices.emplace_back(x, 0.08f * y, 0.08f * z);
      asset.mesh.normals.push_back(Eigen::Vector3f(0.0f, y, z).normalized());
      const float place = std::min((x + 0.5f) * static_cast<float>(joints), static_cast<float>(joints) - 1.0f);
      const int joint = std::min(static_cast<int>(place), static_cast<int>(joints) - 1);
      const float rest = place - static_cast<float>(joint);
      asset.skin.append_row(rest > 0.0f ? std::vector<Influence>{{joint, 1.0f - rest}, {joint + 1, rest}}
                                        : std::vector<Influence>{{joint, 1.0f}});
    }
  }
  for (int ring = 0; ring + 1 < kRings; ++ring) {
    for (int side = 0; side < 4; ++side) {
      const int a = 4 * ring + side, b = 4 * ring + (side + 1) % 4;
      asset.mesh.faces.push_back({a, a + 4, b});
      asset.mesh.faces.push_back({b, a + 4, b + 4});
    }
  }
  const int last = 4 * (kRings - 1);
  asset.mesh.faces.insert(asset.mesh.faces.end(),
                          {{0, 1, 2}, {0, 2, 3}, {last, last + 2, last + 1}, {last, last + 3, last + 2}});
  return asset;
}

/// Joint 1 swings about z from 0 to `degrees` within two seconds.
inline Animation swing(double degrees) {
  Animation animation;
  animation.name = "swing";
  const double half = 0.5 * degrees * kRadians;
  animation.channels.push_back({1,
                                ChannelPath::kRotation,
                                Interpolation::kLinear,
                                {0.0, 2.0},
                                {0, 0, 0, 1, 0, 0, std::sin(half), std::cos(half)}});
  return animation;
}

/// Limits that reject nothing, to look at the poses themselves.
inline PoseAugmentation anything() {
  PoseAugmentation options;
  options.limits = {1e-6, 0, {1e-3, 1e3}, 0, {0, 1e3}, {0, 1e3}, 1, 1, 1};
  return options;
}

/// One variant of an augmenter of its own.
inline std::optional<Asset> posed_variant(const Asset& normalised, const std::string& source_id, std::uint64_t seed,
                                          std::size_t k, const PoseAugmentation& options, Provenance& provenance) {
  return PoseAugmenter(normalised, source_id, seed, options).variant(k, provenance);
}

inline bool equal(const Asset& a, const Asset& b) {
  const auto bytes = [](const auto& x, const auto& y) {
    return x.size() == y.size() && std::memcmp(x.data(), y.data(), x.size() * sizeof(x[0])) == 0;
  };
  bool frames = a.skeleton.size() == b.skeleton.size();
  for (std::size_t j = 0; frames && j < a.skeleton.size(); ++j) frames = a.skeleton.bind[j] == b.skeleton.bind[j];
  return frames && bytes(a.mesh.vertices, b.mesh.vertices) && bytes(a.mesh.normals, b.mesh.normals);
}

inline double swing_angle(const Asset& asset) {
  const Eigen::Matrix3d turn =
      asset.skeleton.bind[0].topLeftCorner<3, 3>().transpose() * asset.skeleton.bind[1].topLeftCorner<3, 3>();
  return std::atan2(turn(1, 0), turn(0, 0)) / kRadians;
}

}  // namespace anigen::prepare
