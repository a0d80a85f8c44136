#include "anigen/models/anymate/point_groups.h"

#include <ATen/Parallel.h>

#include <algorithm>
#include <string>
#include <vector>

#include "anigen/models/anymate/checks.h"

namespace anigen::models::anymate {
namespace {

constexpr float kFarther = 1e10F;  // than any point, before the first choice

void require_count(std::int64_t count, std::int64_t points, const char* what) {
  require(count > 0 && count <= points, what,
          std::to_string(count) + " of " + std::to_string(points) + " points were asked for");
}

// Coordinates apart, so that the loop over points is vectorised.
void choose_farthest(const float* points, std::int64_t n, std::int64_t start, std::int64_t count,
                     std::int64_t* chosen) {
  const auto size = static_cast<std::size_t>(n);
  std::vector<float> x(size), y(size), z(size), distance(size, kFarther);
  for (std::size_t i = 0; i < size; ++i) {
    x[i] = points[3 * i];
    y[i] = points[3 * i + 1];
    z[i] = points[3 * i + 2];
  }
  auto last = static_cast<std::size_t>(start);
  for (std::int64_t choice = 0; choice < count; ++choice) {
    chosen[choice] = static_cast<std::int64_t>(last);
    const float at_x = x[last], at_y = y[last], at_z = z[last];
    for (std::size_t i = 0; i < size; ++i) {
      const float dx = x[i] - at_x, dy = y[i] - at_y, dz = z[i] - at_z;
      distance[i] = std::min(distance[i], dx * dx + dy * dy + dz * dz);
    }
    last = static_cast<std::size_t>(std::max_element(distance.begin(), distance.end()) - distance.begin());
  }
}

}  // namespace

Tensor farthest_points(const Tensor& points, std::int64_t count, const Tensor& start) {
  require_shape(points, {-1, -1, 3}, "points");
  require_shape(start, {points.size(0)}, "start");
  const std::int64_t items = points.size(0), n = points.size(1);
  require_count(count, n, "num_group");
  const Tensor cpu = points.detach().to(torch::kCPU, torch::kFloat32).contiguous();
  const Tensor first = start.to(torch::kCPU, torch::kInt64).contiguous();
  const std::int64_t* begin = first.data_ptr<std::int64_t>();
  require(std::all_of(begin, begin + items, [n](std::int64_t row) { return row >= 0 && row < n; }), "start",
          "is not an index of one of " + std::to_string(n) + " points");
  Tensor chosen = torch::empty({items, count}, torch::kInt64);
  const float* values = cpu.data_ptr<float>();
  auto* out = chosen.data_ptr<std::int64_t>();
  at::parallel_for(0, items, 1, [&](std::int64_t low, std::int64_t high) {
    for (std::int64_t b = low; b < high; ++b) choose_farthest(values + 3 * n * b, n, begin[b], count, out + count * b);
  });
  return chosen.to(points.device());
}

Tensor nearest_points(const Tensor& points, const Tensor& centers, std::int64_t count) {
  require_shape(points, {-1, -1, 3}, "points");
  require_shape(centers, {points.size(0), -1, 3}, "centers");
  require_count(count, points.size(1), "group_size");
  const torch::NoGradGuard no_grad;
  std::vector<Tensor> items;
  for (std::int64_t b = 0; b < points.size(0); ++b) {
    const Tensor all = points[b], center = centers[b];
    Tensor squared = torch::matmul(center, all.t()).mul_(-2.0);
    squared.add_(center.square().sum(-1).unsqueeze(1)).add_(all.square().sum(-1).unsqueeze(0));
    items.push_back(std::get<1>(squared.topk(count, -1, /*largest=*/false, /*sorted=*/false)));
  }
  return torch::stack(items, 0);
}

Tensor rows_of_items(const Tensor& points, const Tensor& rows) {
  const Tensor flat = rows.flatten(1);
  std::vector<std::int64_t> shape = rows.sizes().vec();
  shape.push_back(points.size(-1));
  return points.gather(1, flat.unsqueeze(-1).expand({-1, -1, points.size(-1)})).view(shape);
}

}  // namespace anigen::models::anymate
