#include "anigen/flow/geodesic_noise.h"

#include <tuple>
#include <vector>

#include "anigen/core/config.h"

namespace anigen::flow {

namespace {

constexpr std::int64_t kMostSmoothings = 10000;
constexpr double kLeastDeviation = 1e-8;

// Numbers of voxels in a grid with an empty layer around it, so that the number of a neighbour is a fixed distance away
// and never that of a voxel on the other side or of another item.
struct PaddedNumbers {
  Tensor number;               // [N] int64
  std::int64_t along[3] = {};  // distance to the neighbour along x, y, z
};

PaddedNumbers padded_numbers(const Tensor& coords) {
  const Tensor places = coords.to(torch::kInt64) + 1;
  const Tensor sides = std::get<0>(places.max(0)) + 2;
  PaddedNumbers numbers;
  numbers.along[2] = 1;
  numbers.along[1] = sides[3].item<std::int64_t>();
  numbers.along[0] = numbers.along[1] * sides[2].item<std::int64_t>();
  const std::int64_t item = numbers.along[0] * sides[1].item<std::int64_t>();
  const Tensor strides = torch::tensor(
      std::vector<std::int64_t>{item, numbers.along[0], numbers.along[1], numbers.along[2]}, places.options());
  numbers.number = (places * strides).sum(1);
  return numbers;
}

}  // namespace

void GeodesicNoiseOptions::fields(ConfigFields& f) {
  f("geodesic_smooth_noise", enabled);
  f("geodesic_smooth_noise_iters", iterations, {0, kMostSmoothings});
  f("geodesic_smooth_noise_alpha", alpha, {0.0, 1.0});
}

FaceNeighbours face_neighbours(const Tensor& coords) {
  TORCH_CHECK(coords.dim() == 2 && coords.size(1) == 4, "voxels of shape ", coords.sizes(), ", expected [N, 4]");
  const auto options = torch::TensorOptions().dtype(torch::kInt64).device(coords.device());
  const std::int64_t rows = coords.size(0);
  FaceNeighbours found{torch::empty({0}, options), torch::empty({0}, options), torch::zeros({rows}, options)};
  if (rows == 0) return found;
  const PaddedNumbers numbers = padded_numbers(coords);
  const auto [sorted, order] = numbers.number.sort();
  std::vector<Tensor> row, neighbour;
  for (const std::int64_t along : numbers.along) {
    for (const std::int64_t step : {-along, along}) {
      const Tensor wanted = numbers.number + step;
      const Tensor place = torch::searchsorted(sorted, wanted).clamp_max(rows - 1);
      const Tensor here = (sorted.index_select(0, place) == wanted).nonzero().squeeze(1);
      row.push_back(here);
      neighbour.push_back(order.index_select(0, place.index_select(0, here)));
    }
  }
  found.row = torch::cat(row);
  found.neighbour = torch::cat(neighbour);
  found.degree.index_add_(0, found.row, torch::ones_like(found.row));
  return found;
}

Tensor smooth_geodesic_noise(const Tensor& noise, const FaceNeighbours& neighbours, std::int64_t first,
                             std::int64_t last, const GeodesicNoiseOptions& options) {
  TORCH_CHECK(noise.dim() == 2 && noise.size(0) == neighbours.degree.size(0) && first >= 0 && first <= last &&
                  last <= noise.size(1),
              "smoothing the channels ", first, " to ", last, " of noise ", noise.sizes(), " at ",
              neighbours.degree.size(0), " voxels");
  if (!options.enabled || first == last || noise.size(0) == 0) return noise;
  const Tensor degree = neighbours.degree.unsqueeze(1);
  const Tensor isolated = degree == 0, divisor = degree.clamp_min(1).to(noise.options());
  Tensor f = noise.narrow(1, first, last - first);
  for (std::int64_t i = 0; i < options.iterations; ++i) {
    const Tensor sum = torch::zeros_like(f).index_add(0, neighbours.row, f.index_select(0, neighbours.neighbour));
    f = (1.0 - options.alpha) * f + options.alpha * torch::where(isolated, f, sum / divisor);
  }
  // One voxel has no deviation.
  if (f.size(0) > 1) f = f / f.std(0, /*unbiased=*/true, /*keepdim=*/true).clamp_min(kLeastDeviation);
  return torch::cat({noise.narrow(1, 0, first), f, noise.narrow(1, last, noise.size(1) - last)}, 1);
}

Tensor smooth_geodesic_noise(const Tensor& noise, const Tensor& coords, std::int64_t first, std::int64_t last,
                             const GeodesicNoiseOptions& options) {
  if (!options.enabled) return noise;
  return smooth_geodesic_noise(noise, face_neighbours(coords.to(noise.device())), first, last, options);
}

}  // namespace anigen::flow
