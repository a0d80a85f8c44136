#include "anigen/eval/inspect/influence_loss.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "anigen/asset/skinning.h"

namespace anigen::eval {
namespace {

double row_l1(const SkinWeights& a, const SkinWeights& b, std::size_t v) {
  std::map<std::int32_t, double> difference;
  for (std::size_t i = 0; i < a.row_size(v); ++i) difference[a.row(v)[i].joint] += a.row(v)[i].weight;
  for (std::size_t i = 0; i < b.row_size(v); ++i) difference[b.row(v)[i].joint] -= b.row(v)[i].weight;
  double sum = 0;
  for (const auto& entry : difference) sum += std::abs(entry.second);
  return sum;
}

/// The asset with only some of its vertices and no faces: all that skinning needs.
Asset only_vertices(const Asset& asset, const std::vector<std::size_t>& kept) {
  Asset part;
  part.skeleton = asset.skeleton;
  for (const std::size_t v : kept) {
    part.mesh.vertices.push_back(asset.mesh.vertices[v]);
    part.skin.append_row({asset.skin.row(v), asset.skin.row(v) + asset.skin.row_size(v)});
  }
  return part;
}

}  // namespace

InfluenceLoss influence_loss(const Asset& asset, std::size_t influences, std::size_t frames_per_animation) {
  InfluenceLoss loss;
  loss.influences = influences;
  std::vector<std::size_t> affected;
  for (std::size_t v = 0; v < asset.skin.rows(); ++v) {
    if (asset.skin.row_size(v) > influences) affected.push_back(v);
  }
  loss.affected = affected.size();
  loss.frames = asset.animations.size() * frames_per_animation;
  if (affected.empty()) return loss;

  const Asset full = only_vertices(asset, affected);
  Asset limited = full;
  limited.skin = limit_influences(full.skin, influences);
  for (std::size_t v = 0; v < affected.size(); ++v) {
    const double l1 = row_l1(full.skin, limited.skin, v);
    loss.max_l1 = std::max(loss.max_l1, l1);
    loss.mean_l1 += l1 / static_cast<double>(asset.skin.rows());
  }
  double farthest = 0;
  for (const Animation& animation : asset.animations) {
    for (std::size_t frame = 0; frame < frames_per_animation; ++frame) {
      const double part =
          frames_per_animation > 1 ? static_cast<double>(frame) / static_cast<double>(frames_per_animation - 1) : 0;
      const auto world =
          forward_kinematics(asset.skeleton.parents, sample(animation, asset.skeleton, part * animation.duration()));
      const auto a = skin_vertices(full, world), b = skin_vertices(limited, world);
      for (std::size_t v = 0; v < a.size(); ++v)
        farthest = std::max(farthest, static_cast<double>((a[v] - b[v]).norm()));
    }
  }
  const double diagonal = bounding_box(asset.mesh.vertices).diagonal();
  loss.max_displacement = diagonal > 0 ? farthest / diagonal : 0;
  return loss;
}

Json to_json(const InfluenceLoss& loss) {
  return {{"influences", loss.influences}, {"affected", loss.affected}, {"mean_l1", loss.mean_l1},
          {"max_l1", loss.max_l1},         {"frames", loss.frames},     {"max_displacement", loss.max_displacement}};
}

}  // namespace anigen::eval
