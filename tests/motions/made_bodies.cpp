#include "tests/motions/made_bodies.h"

#include <array>
#include <utility>

#include "anigen/core/numeric.h"

namespace anigen::test {

using Eigen::Vector3d;

int MadeBody::joint(const std::string& name, int parent, const Vector3d& place) {
  names_.push_back(name);
  parents_.push_back(parent);
  places_.push_back(place);
  return static_cast<int>(names_.size()) - 1;
}

std::pair<int, int> MadeBody::pair(const std::string& name, std::pair<int, int> parents, const Vector3d& left) {
  const int first = joint(name + ".L", parents.first, left);
  return {first, joint(name + ".R", parents.second, {-left.x(), left.y(), left.z()})};
}

void MadeBody::box(int joint, const Vector3d& low, const Vector3d& high) { blocks_.push_back({joint, low, high}); }

Asset MadeBody::asset(double thickness, bool names) const {
  Asset asset;
  asset.name = "made";
  std::vector<std::string> called = names_;
  for (std::size_t j = 0; !names && j < called.size(); ++j) called[j] = "joint_" + std::to_string(j);
  asset.skeleton = skeleton_from_joints(places_, parents_, called);
  std::vector<Block> blocks = blocks_;
  std::vector<bool> leads(places_.size(), false);
  const Vector3d around = Vector3d::Constant(0.5 * thickness);
  for (std::size_t j = 0; j < places_.size(); ++j) {
    if (parents_[j] < 0) continue;
    const Vector3d &from = places_[at(parents_[j])], &to = places_[j];
    leads[at(parents_[j])] = true;
    constexpr int kPieces = 4;  // a slanted bone is no single box
    for (int k = 0; k < kPieces; ++k) {
      const Vector3d a = from + (to - from) * k / kPieces, b = from + (to - from) * (k + 1) / kPieces;
      blocks.push_back({parents_[j], a.cwiseMin(b) - around, a.cwiseMax(b) + around});
    }
  }
  for (std::size_t j = 0; j < places_.size(); ++j) {
    if (!leads[j]) blocks.push_back({static_cast<int>(j), places_[j] - around, places_[j] + around});
  }
  for (const Block& block : blocks) {
    const auto first = static_cast<std::int32_t>(asset.mesh.vertices.size());
    for (int k = 0; k < 8; ++k) {
      const Vector3d corner((k & 1) != 0 ? block.high.x() : block.low.x(),
                            (k & 2) != 0 ? block.high.y() : block.low.y(),
                            (k & 4) != 0 ? block.high.z() : block.low.z());
      asset.mesh.vertices.push_back(corner.cast<float>());
      asset.skin.append_row({{block.joint, 1.0F}});
    }
    constexpr std::array<std::array<int, 3>, 12> kFaces = {{{0, 2, 1},
                                                            {1, 2, 3},
                                                            {4, 5, 6},
                                                            {5, 7, 6},
                                                            {0, 1, 4},
                                                            {1, 5, 4},
                                                            {2, 6, 3},
                                                            {3, 6, 7},
                                                            {0, 4, 2},
                                                            {2, 4, 6},
                                                            {1, 3, 5},
                                                            {3, 7, 5}}};
    for (const auto& face : kFaces) asset.mesh.faces.push_back({first + face[0], first + face[1], first + face[2]});
  }
  return asset;
}

Asset made_biped(bool names) {
  MadeBody body;
  const int pelvis = body.joint("pelvis", -1, {0, 0, 1.0}), spine = body.joint("spine", pelvis, {0, 0, 1.2});
  const int chest = body.joint("chest", spine, {0, 0, 1.4}), neck = body.joint("neck", chest, {0, 0, 1.55});
  body.joint("head", neck, {0, 0, 1.65});
  const auto hips = body.pair("thigh", {pelvis, pelvis}, {0.1, 0, 0.95});
  const auto ankles = body.pair("foot", body.pair("shin", hips, {0.1, -0.01, 0.5}), {0.1, 0.02, 0.08});
  body.pair("toe", ankles, {0.1, -0.15, 0.04});
  const auto elbows = body.pair("forearm", body.pair("upperarm", {chest, chest}, {0.18, 0, 1.42}), {0.45, 0, 1.42});
  body.pair("hand", elbows, {0.7, 0, 1.42});
  return body.asset(0.06, names);
}

Asset made_quadruped(bool names) {
  MadeBody body;
  const int pelvis = body.joint("pelvis", -1, {0, 0.5, 0.8}), back = body.joint("back", pelvis, {0, 0.1, 0.82});
  const int chest = body.joint("chest", back, {0, -0.4, 0.8}), neck = body.joint("neck", chest, {0, -0.6, 1.0});
  body.joint("head", neck, {0, -0.8, 1.2});
  const int tail = body.joint("tail1", pelvis, {0, 0.65, 0.8});
  body.joint("tail3", body.joint("tail2", tail, {0, 0.8, 0.75}), {0, 0.95, 0.7});
  for (const auto& [name, from, y] : {std::tuple("front", chest, -0.4), std::tuple("hind", pelvis, 0.5)}) {
    const auto hips = body.pair(std::string(name) + "_upper", {from, from}, {0.15, y, 0.75});
    const auto knees = body.pair(std::string(name) + "_lower", hips, {0.15, y - 0.05, 0.4});
    body.pair(std::string(name) + "_end", knees, {0.15, y, 0.05});
  }
  return body.asset(0.1, names);
}

Asset made_insect(int pairs) {
  MadeBody body;
  const int trunk = body.joint("body", -1, {0, 0, 0.4});
  body.joint("front", trunk, {0, -0.5, 0.4});
  for (int k = 0; k < pairs; ++k) {
    const double y = -0.4 + 0.8 * k / (pairs - 1);
    const auto hips = body.pair("a" + std::to_string(k), {trunk, trunk}, {0.12, 0.6 * y, 0.38});
    const auto knees = body.pair("b" + std::to_string(k), hips, {0.4, y, 0.55});
    body.pair("c" + std::to_string(k), knees, {0.75, 1.3 * y, 0.03});
  }
  body.box(trunk, {-0.1, -0.4, 0.32}, {0.1, 0.5, 0.5});
  return body.asset(0.05, false);
}

Asset made_snake() {
  MadeBody body;
  int last = body.joint("head", -1, {0, 0, 0.05});
  for (int k = 1; k < 12; ++k) last = body.joint("part" + std::to_string(k), last, {0, 0.2 * k, 0.05});
  return body.asset(0.1);
}

Asset made_fish() {
  MadeBody body;
  const int middle = body.joint("middle", -1, {0, 0, 0.3}), front = body.joint("front", middle, {0, -0.3, 0.3});
  body.joint("snout", front, {0, -0.5, 0.3});
  int last = middle;
  for (int k = 1; k < 4; ++k) last = body.joint("rear" + std::to_string(k), last, {0, 0.3 * k, 0.3});
  body.pair("side_end", body.pair("side", {front, front}, {0.12, -0.2, 0.25}), {0.4, -0.1, 0.2});
  body.box(middle, {-0.1, -0.4, 0.0}, {0.1, 0.4, 0.6});
  body.box(last, {-0.01, 0.9, 0.1}, {0.01, 1.1, 0.5});
  return body.asset(0.06, false);
}

Asset made_lamp() {
  MadeBody body;
  const int foot = body.joint("base", -1, {0, 0, 0.02}), pole = body.joint("pole", foot, {0, 0, 0.5});
  body.joint("shade", body.joint("arm", pole, {0, -0.2, 0.9}), {0, -0.5, 0.8});
  body.box(foot, {-0.2, -0.2, 0.0}, {0.2, 0.2, 0.04});
  return body.asset(0.05, false);
}

}  // namespace anigen::test
