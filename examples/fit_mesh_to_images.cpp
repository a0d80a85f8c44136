// Recovers meshes from pictures of them by gradient descent through the differentiable rasteriser: first where a
// ring lies (three numbers), then what shape it has (every vertex). Draws target, start and result of both.
//   example_fit_mesh_to_images OUT.png
#include <ATen/Parallel.h>

#include <algorithm>
#include <cstdio>
#include <exception>
#include <functional>
#include <string>
#include <vector>

#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"
#include "anigen/io/image.h"
#include "anigen/raster/mesh_renderer.h"
#include "anigen/render/cameras_json.h"
#include "anigen/render/contact_sheet.h"

namespace {

using anigen::raster::Rendering;
using torch::Tensor;

constexpr std::int64_t kRings = 72, kSegments = 36, kPixels = 128;
constexpr std::size_t kViews = 8;

struct View {
  Tensor extrinsics, intrinsics;
};

Tensor tensor_of(const Eigen::MatrixXd& matrix) {
  Tensor tensor = torch::empty({matrix.rows(), matrix.cols()});
  for (Eigen::Index i = 0; i < matrix.rows(); ++i) {
    for (Eigen::Index j = 0; j < matrix.cols(); ++j) tensor[i][j].fill_(matrix(i, j));
  }
  return tensor;
}

std::vector<View> views_around() {
  std::vector<View> views;
  for (const anigen::render::ViewCamera& camera : anigen::render::feature_views(kViews, 0.5, 0.5)) {
    views.push_back({tensor_of(anigen::render::extrinsics_of(anigen::render::camera_to_world(camera))),
                     tensor_of(anigen::render::intrinsics_of(camera.fov))});
  }
  return views;
}

/// A ring with bumps of that height. @return [V, 3]
Tensor ring(double bumps) {
  const Tensor u = torch::arange(kRings).to(torch::kFloat32).mul(2.0 * anigen::kPi / kRings).unsqueeze(1);
  const Tensor v = torch::arange(kSegments).to(torch::kFloat32).mul(2.0 * anigen::kPi / kSegments).unsqueeze(0);
  const Tensor tube = 0.12 + bumps * torch::sin(5.0 * u) * torch::cos(2.0 * v);
  const Tensor radius = 0.3 + tube * torch::cos(v);
  return torch::stack(
             {radius * torch::cos(u), radius * torch::sin(u), tube * torch::sin(v) + bumps * torch::cos(2.0 * u)}, 2)
      .view({-1, 3});
}

/// @return [F, 3]
Tensor ring_faces() {
  std::vector<std::int64_t> faces;
  const auto at = [](std::int64_t r, std::int64_t s) { return (r % kRings) * kSegments + s % kSegments; };
  for (std::int64_t r = 0; r < kRings; ++r) {
    for (std::int64_t s = 0; s < kSegments; ++s) {
      faces.insert(faces.end(), {at(r, s), at(r + 1, s), at(r + 1, s + 1)});
      faces.insert(faces.end(), {at(r, s), at(r + 1, s + 1), at(r, s + 1)});
    }
  }
  return torch::tensor(faces, torch::kInt64).view({-1, 3});
}

Rendering render(const Tensor& vertices, const Tensor& faces, const View& view) {
  anigen::raster::RenderOptions options;
  options.resolution = kPixels;
  return anigen::raster::render_mesh(vertices, faces, Tensor(), view.extrinsics, view.intrinsics, options);
}

std::vector<Rendering> render_all(const Tensor& vertices, const Tensor& faces, const std::vector<View>& views) {
  const torch::NoGradGuard no_grad;
  std::vector<Rendering> pictures;
  for (const View& view : views) pictures.push_back(render(vertices, faces, view));
  return pictures;
}

double mean_distance(const Tensor& a, const Tensor& b) { return (a - b).norm(2, 1).mean().item<double>(); }

struct Problem {
  std::string name;
  Tensor target;                                     ///< [V, 3]; only its pictures are used
  Tensor parameters;                                 ///< what is searched for, at its start
  std::function<Tensor(const Tensor&)> vertices_of;  ///< parameters → [V, 3]
  std::function<Tensor(const Tensor&)> penalty;      ///< of parameters; scalar
  double rate;                                       ///< of Adam
  int steps;
};

/// @return the vertices found
Tensor fit(const Problem& problem, const Tensor& faces, const std::vector<View>& views) {
  const std::vector<Rendering> targets = render_all(problem.target, faces, views);
  const Tensor parameters = problem.parameters.clone().requires_grad_();
  torch::optim::Adam optimizer(std::vector<Tensor>{parameters}, torch::optim::AdamOptions(problem.rate));
  for (int step = 0; step <= problem.steps; ++step) {
    optimizer.zero_grad();
    const Tensor vertices = problem.vertices_of(parameters);
    Tensor loss = problem.penalty(parameters);
    for (std::size_t i = 0; i < views.size(); ++i) {
      const Rendering found = render(vertices, faces, views[i]);
      loss = loss + (found.mask - targets[i].mask).abs().mean() + (found.depth - targets[i].depth).abs().mean() +
             0.2 * (found.normal - targets[i].normal).abs().mean();
    }
    if (step % 40 == 0 || step == problem.steps) {
      std::printf("%-12s step %3d: loss %.5f, vertices off by %.5f\n", problem.name.c_str(), step, loss.item<double>(),
                  mean_distance(vertices.detach(), problem.target));
    }
    if (step == problem.steps) break;
    loss.backward();
    optimizer.step();
  }
  const torch::NoGradGuard no_grad;
  return problem.vertices_of(parameters);
}

/// Σ |offset − mean of its neighbours'|²: neighbours move together.
Tensor roughness(const Tensor& offsets) {
  const Tensor grid = offsets.view({kRings, kSegments, 3});
  const Tensor around =
      torch::roll(grid, 1, 0) + torch::roll(grid, -1, 0) + torch::roll(grid, 1, 1) + torch::roll(grid, -1, 1);
  return (grid - 0.25 * around).square().sum();
}

anigen::io::Image picture(const Rendering& rendering) {
  const Tensor values = (255.0 * torch::cat({rendering.normal, rendering.mask.unsqueeze(2)}, 2))
                            .clamp(0.0, 255.0)
                            .round()
                            .to(torch::kUInt8)
                            .contiguous();
  anigen::io::Image image(static_cast<int>(kPixels), static_cast<int>(kPixels), 0);
  std::copy_n(values.data_ptr<std::uint8_t>(), image.rgba.size(), image.rgba.begin());
  return image;
}

void add_row(std::vector<anigen::render::Tile>& tiles, const std::string& name, const std::vector<Tensor>& meshes,
             const Tensor& faces, const View& view) {
  const char* const states[] = {"target", "start", "result"};
  const torch::NoGradGuard no_grad;
  for (std::size_t i = 0; i < meshes.size(); ++i) {
    tiles.push_back({picture(render(meshes[i], faces, view)), name + ": " + states[i]});
  }
}

void run(const std::string& out) {
  const std::vector<View> views = views_around();
  const Tensor faces = ring_faces(), plain = ring(0.0), bumpy = ring(0.025);
  const Tensor moved = plain + torch::tensor({0.1F, -0.07F, 0.08F});
  const std::vector<Problem> problems{
      {"translation", moved, torch::zeros({3}), [&](const Tensor& p) { return plain + p; },
       [](const Tensor&) { return torch::zeros(1).sum(); }, 0.005, 80},
      {"deformation", bumpy, torch::zeros_like(plain), [&](const Tensor& p) { return plain + p; },
       [](const Tensor& p) { return 0.1 * roughness(p); }, 0.001, 160}};
  std::vector<anigen::render::Tile> tiles;
  for (const Problem& problem : problems) {
    const Tensor start = problem.vertices_of(problem.parameters), result = fit(problem, faces, views);
    for (const std::size_t view : {std::size_t{0}, views.size() / 2}) {
      add_row(tiles, problem.name, {problem.target, start, result}, faces, views[view]);
    }
  }
  anigen::render::SheetOptions sheet;
  sheet.columns = 6;
  sheet.gap = 6;
  sheet.text_height = 9;
  anigen::io::write_png(out, anigen::render::contact_sheet(tiles, sheet));
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: example_fit_mesh_to_images OUT.png\n");
    return 2;
  }
  try {
    at::set_num_threads(anigen::thread_count());
    run(argv[1]);
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 1;
  }
}
