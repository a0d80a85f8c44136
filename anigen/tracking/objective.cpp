#include "anigen/tracking/objective.h"

#include <algorithm>
#include <cmath>

#include "anigen/raster/antialias.h"
#include "anigen/raster/rasterize.h"

namespace anigen::tracking {

namespace {

constexpr std::int64_t kHarmonics = 9;
constexpr double kColorScale = 0.05;     // ε: errors below it count by their square
constexpr double kReachOfPoint = 0.012;  // r, in sides: spacing of the points on the surface
constexpr double kFewJoints = 10.0;      // a rig of fewer is held as little as one of these
constexpr double kRidge = 3e-3;
constexpr double kLeastLight = 1e-4;
constexpr double kLeastGain = 0.5;  // of a colour channel against the light of all three; 1 / it is the most

/// Spherical harmonics of order 0, 1 and 2 without their constants. @param normals [C, 3] @return [C, 9]
Tensor harmonics(const Tensor& normals) {
  const Tensor x = normals.select(1, 0), y = normals.select(1, 1), z = normals.select(1, 2);
  return torch::stack({torch::ones_like(x), x, y, z, x * y, y * z, x * z, x * x - y * y, 3.0 * z * z - 1.0}, 1);
}

/// Bilinear lookup at places (u, v); outside the picture the nearest pixel and the way to it.
Tensor distance_at(const Tensor& outside, const Tensor& places) {
  const Tensor inside = places.clamp(0.0, 1.0);
  const Tensor grid = (2.0 * inside - 1.0).view({1, 1, -1, 2});
  const auto options = torch::nn::functional::GridSampleFuncOptions()
                           .mode(torch::kBilinear)
                           .padding_mode(torch::kBorder)
                           .align_corners(false);
  const Tensor found = torch::nn::functional::grid_sample(outside.unsqueeze(0).unsqueeze(0), grid, options).flatten();
  return found + (places - inside).square().sum(1).add(1e-12).sqrt() - 1e-6;
}

Tensor pose_sum(const RigTensors& rig, const Tensor& squares) {  // [N, J, 1] → per pose
  const double free = std::max(kFewJoints, rig.is_free.sum().item<double>());
  return (squares * rig.is_free).sum() / (free * static_cast<double>(squares.size(0)));
}

}  // namespace

Light plain_light() {
  Tensor light = torch::zeros({kHarmonics, 3}, torch::kFloat64);
  light[0].fill_(1.0);
  return light;
}

Rendering render_rig(const RigTensors& rig, const Tensor& clip, const Tensor& normals, const Light& light,
                     std::int64_t size) {
  const raster::Fragments fragments = raster::rasterize(clip, rig.faces, size, size, 8);
  const Tensor lit = (rig.colors * harmonics(normals).matmul(light)).clamp_min(kLeastLight).sqrt();
  const Tensor color = raster::interpolate(lit, fragments, rig.color_faces);
  const Tensor mask = (fragments.triangle > 0).to(torch::kFloat64).unsqueeze(2);
  const Tensor image = raster::antialias(torch::cat({mask, color}, 2), fragments, clip, rig.faces);
  return {image.select(2, 0), image.narrow(2, 1, 3)};
}

Light fit_light(const RigTensors& rig, const Tensor& clip, const Tensor& normals, const FrameLevel& frame) {
  const torch::NoGradGuard no_grad;
  const raster::Fragments fragments = raster::rasterize(clip, rig.faces, frame.size(), frame.size(), 8);
  const Tensor seen = raster::interpolate(torch::cat({rig.colors, normals}, 1), fragments, rig.color_faces);
  const Tensor both = ((fragments.triangle > 0) & (frame.alpha > 0.9)).flatten().nonzero().flatten();
  if (both.numel() < 4 * kHarmonics) return plain_light();
  const Tensor pixels = seen.view({-1, 6}).index_select(0, both);
  const Tensor wanted = frame.color.view({-1, 3}).index_select(0, both).square();  // linear light
  const Tensor base = pixels.narrow(1, 0, 3), normal = pixels.narrow(1, 3, 3);
  const Tensor basis = harmonics(normal / normal.norm(2, 1, true).clamp_min(1e-6));
  // One light for the three channels, then their gains: light of nine free colours would explain away what a turn
  // shows.
  const Tensor rows = (basis.unsqueeze(1) * base.unsqueeze(2)).view({-1, kHarmonics});
  const double count = static_cast<double>(rows.size(0));
  const double brightness =
      std::clamp((wanted.sum() / base.sum().clamp_min(1e-6)).item<double>(), kLeastGain * kLeastGain, 20.0);
  // The ridge pulls towards one brightness, that of the whole picture.
  const Tensor ridge = kRidge * torch::eye(kHarmonics, torch::kFloat64),
               prior = torch::zeros({kHarmonics, 1}, torch::kFloat64);
  prior[0].fill_(brightness);
  const Tensor solution = torch::linalg_solve(rows.t().matmul(rows) / count + ridge,
                                              rows.t().matmul(wanted.reshape({-1, 1})) / count + ridge.matmul(prior));
  const Tensor gray = base * basis.matmul(solution);  // what white light of this shape makes of the base colours
  const Tensor gain = ((gray * wanted).sum(0) + kRidge) / (gray.square().sum(0) + kRidge);
  return solution * gain.clamp(kLeastGain, 1.0 / kLeastGain).unsqueeze(0);
}

Tensor picture_energy(const RigTensors& rig, const Tensor& vertices, const Tensor& normals, const PinholeCamera& camera,
                      const FrameLevel& frame, const Light& light, const ObjectiveWeights& weights) {
  const Tensor clip = clip_positions(vertices, camera);
  const Rendering seen = render_rig(rig, clip, normals, light, frame.size());
  Tensor energy = weights.silhouette * (seen.mask - frame.alpha).square().sum() / frame.area;
  if (weights.color > 0.0) {
    const Tensor square = (seen.color - frame.color).square().sum(2);
    energy = energy + weights.color * ((square + kColorScale * kColorScale).sqrt() - kColorScale).sum() / frame.area;
  }
  if (weights.distance > 0.0) {
    const Tensor places = picture_places(clip_positions(surface_samples(rig, vertices), camera));
    const Tensor beyond = distance_at(frame.outside, places).square().mean();
    Tensor nearest;
    {
      const torch::NoGradGuard no_grad;
      nearest = torch::cdist(frame.points, places).argmin(1);
    }
    const Tensor way = (frame.points - places.index_select(0, nearest)).square().sum(1).add(1e-12).sqrt();
    const Tensor uncovered = (way - kReachOfPoint).clamp_min(0.0).square().mean();
    const double share = frame.area / static_cast<double>(frame.size() * frame.size());
    energy = energy + weights.distance * (beyond + uncovered) / share;
  }
  return energy;
}

Tensor pose_energy(const RigTensors& rig, const Tensor& turns, const ObjectiveWeights& weights) {
  Tensor counted = torch::ones({rig.joints(), 1}, torch::kFloat64);
  counted[0].fill_(0.0);  // the whole may turn about any axis
  const Tensor about = (turns * rig.bone_axis).sum(2, true);
  const Tensor squares = weights.rest * turns.square().sum(2, true) + weights.twist * about.square() * counted;
  return pose_sum(rig, squares);
}

Tensor change_energy(const RigTensors& rig, const Tensor& turns, const Tensor& before, const Tensor& shift,
                     const Tensor& shift_before, double size, double weight) {
  const Tensor turned = pose_sum(rig, (turns - before).square().sum(2, true));
  const Tensor moved = (shift - shift_before).square().sum() / (size * size * static_cast<double>(shift.size(0)));
  return weight * (turned + moved);
}

double overlap_of(const Tensor& mask, const Tensor& alpha) {
  const torch::NoGradGuard no_grad;
  const double both = torch::minimum(mask, alpha).sum().item<double>();
  const double either = torch::maximum(mask, alpha).sum().item<double>();
  return either > 0.0 ? both / either : 1.0;
}

}  // namespace anigen::tracking
