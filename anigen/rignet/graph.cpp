#include "anigen/rignet/graph.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "anigen/anymate/blocks.h"
#include "anigen/nn/init.h"

namespace anigen::rignet {

namespace {

using anymate::require;
using anymate::require_shape;
using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

constexpr std::int64_t kLeastTargets = 64, kLeastChannels = 8;  // of a task

// Rows of x [N, C] summed per run. Each run belongs to one task, so the order of summation is fixed.
template <typename T>
void sum_runs(const T* rows, const std::int64_t* offsets, std::int64_t runs, std::int64_t channels, T* sums) {
  at::parallel_for(0, runs, kLeastTargets, [&](std::int64_t first, std::int64_t last) {
    for (std::int64_t i = first; i < last; ++i) {
      T* out = sums + i * channels;
      for (std::int64_t e = offsets[i]; e < offsets[i + 1]; ++e) {
        const T* row = rows + e * channels;
        for (std::int64_t c = 0; c < channels; ++c) out[c] += row[c];
      }
    }
  });
}

// Rows added to the places that index names. Tasks share out channels: any of them may meet any place.
template <typename T>
void add_rows(const T* rows, const std::int64_t* index, std::int64_t count, std::int64_t channels, T* sums) {
  at::parallel_for(0, channels, kLeastChannels, [&](std::int64_t first, std::int64_t last) {
    for (std::int64_t e = 0; e < count; ++e) {
      const T* row = rows + e * channels;
      T* out = sums + index[e] * channels;
      for (std::int64_t c = first; c < last; ++c) out[c] += row[c];
    }
  });
}

class EdgeSums : public torch::autograd::Function<EdgeSums> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& at_target, const Tensor& at_source,
                        const Tensor& offsets, const Tensor& sources) {
    context->save_for_backward({offsets, sources});
    context->saved_data["source rows"] = at_source.size(0);
    const Tensor targets = at_target.contiguous(), from = at_source.contiguous();
    const std::int64_t channels = targets.size(1);
    Tensor out = torch::empty({sources.size(0), channels}, targets.options());
    const auto* starts = offsets.data_ptr<std::int64_t>();
    const auto* source = sources.data_ptr<std::int64_t>();
    AT_DISPATCH_FLOATING_TYPES(targets.scalar_type(), "edge_sums", [&] {
      const auto *own = targets.data_ptr<scalar_t>(), *other = from.data_ptr<scalar_t>();
      auto* sums = out.data_ptr<scalar_t>();
      at::parallel_for(0, targets.size(0), kLeastTargets, [&](std::int64_t first, std::int64_t last) {
        for (std::int64_t i = first; i < last; ++i) {
          const scalar_t* a = own + i * channels;
          for (std::int64_t e = starts[i]; e < starts[i + 1]; ++e) {
            const scalar_t* b = other + source[e] * channels;
            scalar_t* sum = sums + e * channels;
            for (std::int64_t c = 0; c < channels; ++c) sum[c] = a[c] + b[c];
          }
        }
      });
    });
    return out;
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    TORCH_CHECK(!at::GradMode::is_enabled(), "edge sums can be differentiated once only");
    const variable_list saved = context->get_saved_variables();
    const Tensor slopes = gradients[0].contiguous();
    const std::int64_t targets = saved[0].size(0) - 1, edges = slopes.size(0), channels = slopes.size(1);
    Tensor d_target, d_source;
    AT_DISPATCH_FLOATING_TYPES(slopes.scalar_type(), "edge_sums_backward", [&] {
      const auto* rows = slopes.data_ptr<scalar_t>();
      if (context->needs_input_grad(0)) {
        d_target = torch::zeros({targets, channels}, slopes.options());
        sum_runs(rows, saved[0].data_ptr<std::int64_t>(), targets, channels, d_target.data_ptr<scalar_t>());
      }
      if (context->needs_input_grad(1)) {
        d_source = torch::zeros({context->saved_data["source rows"].toInt(), channels}, slopes.options());
        add_rows(rows, saved[1].data_ptr<std::int64_t>(), edges, channels, d_source.data_ptr<scalar_t>());
      }
    });
    return {d_target, d_source, Tensor(), Tensor()};
  }
};

class RunMaxima : public torch::autograd::Function<RunMaxima> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& values, const Tensor& offsets) {
    const Tensor rows = values.contiguous();
    const std::int64_t runs = offsets.size(0) - 1, channels = rows.size(1);
    Tensor out = torch::empty({runs, channels}, rows.options());
    Tensor chosen = torch::empty({runs, channels}, torch::kInt64);
    const auto* starts = offsets.data_ptr<std::int64_t>();
    auto* choice = chosen.data_ptr<std::int64_t>();
    AT_DISPATCH_FLOATING_TYPES(rows.scalar_type(), "run_maxima", [&] {
      const auto* all = rows.data_ptr<scalar_t>();
      auto* maxima = out.data_ptr<scalar_t>();
      at::parallel_for(0, runs, kLeastTargets, [&](std::int64_t first, std::int64_t last) {
        for (std::int64_t i = first; i < last; ++i) {
          scalar_t* best = maxima + i * channels;
          std::int64_t* from = choice + i * channels;
          for (std::int64_t c = 0; c < channels; ++c) {
            best[c] = all[starts[i] * channels + c];
            from[c] = starts[i];
          }
          for (std::int64_t e = starts[i] + 1; e < starts[i + 1]; ++e) {
            const scalar_t* row = all + e * channels;
            for (std::int64_t c = 0; c < channels; ++c) {
              if (!(row[c] > best[c]) && !std::isnan(row[c])) continue;
              best[c] = row[c];
              from[c] = e;
            }
          }
        }
      });
    });
    context->save_for_backward({chosen});
    context->saved_data["rows"] = rows.size(0);
    return out;
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    TORCH_CHECK(!at::GradMode::is_enabled(), "run maxima can be differentiated once only");
    const Tensor chosen = context->get_saved_variables()[0], slopes = gradients[0].contiguous();
    Tensor d_values = torch::zeros({context->saved_data["rows"].toInt(), slopes.size(1)}, slopes.options());
    d_values.scatter_(0, chosen, slopes);  // a row belongs to one run, so no place is named twice
    return {d_values, Tensor()};
  }
};

void require_floating(const Tensor& x, const char* what) {
  require(x.defined() && x.is_floating_point(), what, "must hold floating-point numbers");
}

void require_runs(const Tensor& offsets, std::int64_t rows) {
  require_shape(offsets, {-1}, "offsets");
  require(offsets.scalar_type() == torch::kInt64 && offsets.size(0) >= 1, "offsets", "must be int64, at least one");
  const Tensor lengths = offsets.diff();
  require(offsets[0].item<std::int64_t>() == 0 && offsets[-1].item<std::int64_t>() == rows &&
              (lengths > 0).all().item<bool>(),
          "offsets", "must ascend from 0 to " + std::to_string(rows) + " without an empty run");
}

bool by_hand(const Tensor& x) {
  return x.is_cpu() && (x.scalar_type() == torch::kFloat32 || x.scalar_type() == torch::kFloat64);
}

// Runs after runs: offsets of the following ones move by what came before.
Tensor appended_offsets(const std::vector<Tensor>& offsets) {
  std::vector<Tensor> parts = {offsets.front()};
  Tensor before = offsets.front().slice(0, -1);
  for (std::size_t i = 1; i < offsets.size(); ++i) {
    parts.push_back(offsets[i].slice(0, 1) + before);
    before = parts.back().slice(0, -1);
  }
  return torch::cat(parts);
}

EdgeSet joined_edges(const std::vector<MeshGraph>& graphs, EdgeSet MeshGraph::*edges) {
  std::vector<Tensor> offsets, sources;
  std::int64_t before = 0;
  for (const MeshGraph& graph : graphs) {
    offsets.push_back((graph.*edges).offsets);
    sources.push_back((graph.*edges).sources + before);
    before += graph.vertices.size(0);
  }
  return {appended_offsets(offsets), torch::cat(sources)};
}

constexpr std::size_t kNearestCoarse = 3;
constexpr double kLeastSquare = 1e-16;

struct PointList {
  std::vector<Eigen::Vector3d> at;
  std::vector<std::int64_t> starts;
};

PointList listed(const PointSets& sets) {
  PointList list{nn::points_of<double>(sets.positions, "positions"), {}};
  anymate::require_shape(sets.starts, {-1}, "starts");
  const Tensor starts = sets.starts.to(torch::kCPU, torch::kInt64).contiguous();
  const auto* first = starts.data_ptr<std::int64_t>();
  list.starts.assign(first, first + starts.size(0));
  for (std::size_t b = 0; b + 1 < list.starts.size(); ++b)
    anymate::require(list.starts[b] < list.starts[b + 1], "starts", "name a set without points");
  anymate::require(!list.starts.empty() && list.starts.back() == sets.positions.size(0), "starts",
                   "do not end at the number of points");
  return list;
}

const Eigen::Vector3d& point(const PointList& list, std::int64_t row) { return list.at[static_cast<std::size_t>(row)]; }

std::vector<std::int64_t> farthest_points(const PointList& list, std::int64_t first, std::int64_t last, double ratio) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (std::int64_t i = first; i < last; ++i) mean += point(list, i) / static_cast<double>(last - first);
  std::vector<double> left;
  for (std::int64_t i = first; i < last; ++i) left.push_back((point(list, i) - mean).squaredNorm());
  const auto wanted = static_cast<std::size_t>(std::ceil(ratio * static_cast<double>(last - first)));
  std::vector<std::int64_t> chosen;
  while (chosen.size() < std::max<std::size_t>(wanted, 1)) {
    const auto best = std::max_element(left.begin(), left.end()) - left.begin();
    const std::int64_t next = first + best;
    if (chosen.empty()) std::fill(left.begin(), left.end(), 1e300);
    chosen.push_back(next);
    for (std::int64_t i = first; i < last; ++i) {
      double& distance = left[static_cast<std::size_t>(i - first)];
      distance = std::min(distance, (point(list, i) - point(list, next)).squaredNorm());
    }
    left[static_cast<std::size_t>(best)] = -1.0;  // points in one place are still taken once each
  }
  std::sort(chosen.begin(), chosen.end());
  return chosen;
}

// The rows of a set by distance from a place, with the squares.
std::vector<std::pair<double, std::int64_t>> by_distance(const PointList& list, std::int64_t first, std::int64_t last,
                                                         const Eigen::Vector3d& place) {
  std::vector<std::pair<double, std::int64_t>> found;
  for (std::int64_t i = first; i < last; ++i) found.emplace_back((point(list, i) - place).squaredNorm(), i);
  std::sort(found.begin(), found.end());
  return found;
}

constexpr std::int64_t kLeastWidth = 8;

}  // namespace

Tensor run_of_rows(const Tensor& offsets) {
  return torch::repeat_interleave(torch::arange(offsets.size(0) - 1, offsets.options()), offsets.diff());
}

Tensor indexed_edge_sums(const Tensor& at_target, const Tensor& at_source, const EdgeSet& edges) {
  return at_target.index_select(0, run_of_rows(edges.offsets)) + at_source.index_select(0, edges.sources);
}

Tensor scattered_maxima(const Tensor& values, const Tensor& offsets) {
  const Tensor runs = run_of_rows(offsets).unsqueeze(1).expand_as(values);
  const Tensor least =
      torch::full({offsets.size(0) - 1, values.size(1)}, -std::numeric_limits<double>::infinity(), values.options());
  return least.scatter_reduce(0, runs, values, "amax");
}

Tensor edge_sums(const Tensor& at_target, const Tensor& at_source, const EdgeSet& edges) {
  require_floating(at_target, "at_target");
  require_shape(at_target, {edges.targets(), -1}, "at_target");
  require_shape(at_source, {-1, at_target.size(1)}, "at_source");
  require(at_source.scalar_type() == at_target.scalar_type(), "at_source", "has another dtype than at_target");
  if (!by_hand(at_target)) return indexed_edge_sums(at_target, at_source, edges);
  require_runs(edges.offsets, edges.size());
  require(edges.sources.scalar_type() == torch::kInt64 && edges.size() > 0 &&
              edges.sources.min().item<std::int64_t>() >= 0 &&
              edges.sources.max().item<std::int64_t>() < at_source.size(0),
          "sources", "must be int64 indices of rows of at_source");
  return EdgeSums::apply(at_target, at_source, edges.offsets.contiguous(), edges.sources.contiguous());
}

Tensor run_maxima(const Tensor& values, const Tensor& offsets) {
  require_floating(values, "values");
  require_shape(values, {-1, -1}, "values");
  if (!by_hand(values)) return scattered_maxima(values, offsets);
  require_runs(offsets, values.size(0));
  return RunMaxima::apply(values, offsets.contiguous());
}

MeshGraph joined(const std::vector<MeshGraph>& graphs) {
  anymate::require(!graphs.empty(), "graphs", "there is none");
  std::vector<Tensor> vertices, starts;
  for (const MeshGraph& graph : graphs) {
    vertices.push_back(graph.vertices);
    starts.push_back(graph.starts);
  }
  return {torch::cat(vertices), joined_edges(graphs, &MeshGraph::ring), joined_edges(graphs, &MeshGraph::ball),
          appended_offsets(starts)};
}

Tensor starts_of(const std::vector<std::int64_t>& counts) {
  std::vector<std::int64_t> starts = {0};
  for (const std::int64_t count : counts) starts.push_back(starts.back() + count);
  return torch::tensor(starts, torch::kInt64);
}

Tensor spread(const Tensor& rows, const Tensor& starts) { return rows.index_select(0, run_of_rows(starts)); }

Balls gather_balls(const PointSets& points, double ratio, double radius, std::int64_t most) {
  const PointList list = listed(points);
  std::vector<std::int64_t> centres, counts, sources, degrees;
  for (std::size_t b = 0; b + 1 < list.starts.size(); ++b) {
    const std::int64_t first = list.starts[b], last = list.starts[b + 1];
    const std::vector<std::int64_t> chosen = farthest_points(list, first, last, ratio);
    centres.insert(centres.end(), chosen.begin(), chosen.end());
    counts.push_back(static_cast<std::int64_t>(chosen.size()));
    for (const std::int64_t centre : chosen) {
      std::int64_t degree = 0;
      for (const auto& [squared, row] : by_distance(list, first, last, point(list, centre))) {
        if (squared > radius * radius || degree == most) break;
        sources.push_back(row);
        ++degree;
      }
      degrees.push_back(degree);
    }
  }
  const torch::Device device = points.positions.device();
  Balls balls;
  balls.centres.positions = points.positions.index_select(0, torch::tensor(centres, torch::kInt64).to(device));
  balls.centres.starts = starts_of(counts).to(device);
  balls.edges = EdgeSet{starts_of(degrees), torch::tensor(sources, torch::kInt64)}.to(device);
  return balls;
}

Tensor interpolated(const PointSets& coarse, const Tensor& values, const PointSets& fine) {
  anymate::require_shape(values, {coarse.positions.size(0), -1}, "values");
  const PointList from = listed(coarse), to = listed(fine);
  anymate::require(from.starts.size() == to.starts.size(), "starts", "are of other sets");
  const auto rows = static_cast<std::int64_t>(to.at.size()), slots = static_cast<std::int64_t>(kNearestCoarse);
  Tensor index = torch::zeros({rows, slots}, torch::kInt64), share = torch::zeros({rows, slots}, torch::kFloat64);
  auto place = index.accessor<std::int64_t, 2>();
  auto weight = share.accessor<double, 2>();
  for (std::size_t b = 0; b + 1 < to.starts.size(); ++b) {
    for (std::int64_t row = to.starts[b]; row < to.starts[b + 1]; ++row) {
      const auto nearest = by_distance(from, from.starts[b], from.starts[b + 1], point(to, row));
      for (std::size_t k = 0; k < std::min(kNearestCoarse, nearest.size()); ++k) {
        const auto slot = static_cast<std::int64_t>(k);
        place[row][slot] = nearest[k].second;
        weight[row][slot] = 1.0 / (nearest[k].first + kLeastSquare);
      }
    }
  }
  share = (share / share.sum(1, true)).to(values.device(), values.scalar_type());
  const Tensor taken = values.index_select(0, index.flatten().to(values.device())).view({rows, slots, values.size(1)});
  return (taken * share.unsqueeze(2)).sum(1);
}

Tensor batch_normed(torch::nn::BatchNorm1d& norm, const Tensor& x) {
  if (x.size(0) > 1) return norm(x);
  return torch::batch_norm(x, norm->weight, norm->bias, norm->running_mean, norm->running_var, /*training=*/false,
                           /*momentum=*/0.0, norm->options.eps(), /*cudnn_enabled=*/false);
}

ReluNormImpl::ReluNormImpl(std::int64_t in, std::int64_t out) {
  linear_ = register_module("linear", nn::Linear(in, out));
  norm_ = register_module("norm", torch::nn::BatchNorm1d(out));
}

Tensor ReluNormImpl::forward(const Tensor& x) { return batch_normed(norm_, torch::relu(linear_(x))); }

DenseStackImpl::DenseStackImpl(const std::vector<std::int64_t>& widths) {
  for (std::size_t i = 0; i + 1 < widths.size(); ++i)
    layers_.push_back(register_module(std::to_string(i), ReluNorm(widths[i], widths[i + 1])));
}

Tensor DenseStackImpl::forward(Tensor x) {
  for (ReluNorm& layer : layers_) x = layer(x);
  return x;
}

EdgeMessageImpl::EdgeMessageImpl(std::int64_t in, std::int64_t out) : in_(in) {
  first_ = register_module("first", nn::Linear(2 * in, out));
  norm_ = register_module("norm", torch::nn::BatchNorm1d(out));
  second_ = register_module("second", ReluNorm(out, out));
}

Tensor EdgeMessageImpl::forward(const Tensor& x, const EdgeSet& edges) {
  anymate::require_shape(x, {-1, in_}, "x");
  const Tensor of_target = first_->weight.narrow(1, 0, in_), of_way = first_->weight.narrow(1, in_, in_);
  const Tensor at_target = torch::linear(x, of_target - of_way, first_->bias), at_source = torch::linear(x, of_way);
  const Tensor messages = batch_normed(norm_, torch::relu(edge_sums(at_target, at_source, edges)));
  return run_maxima(second_(messages), edges.offsets);
}

GraphUnitImpl::GraphUnitImpl(std::int64_t in, std::int64_t out) {
  anymate::require(out % 2 == 0, "width", "of a unit must be even");
  ring_ = register_module("ring", EdgeMessage(in, out / 2));
  ball_ = register_module("ball", EdgeMessage(in, out / 2));
  mix_ = register_module("mix", ReluNorm(out, out));
}

Tensor GraphUnitImpl::forward(const Tensor& x, const MeshGraph& graph) {
  return mix_(torch::cat({ring_(x, graph.ring), ball_(x, graph.ball)}, 1));
}

GraphStackImpl::GraphStackImpl(const std::vector<std::int64_t>& widths) {
  for (std::size_t i = 0; i + 1 < widths.size(); ++i)
    units_.push_back(register_module(std::to_string(i), GraphUnit(widths[i], widths[i + 1])));
}

Tensor GraphStackImpl::forward(Tensor x, const MeshGraph& graph) {
  std::vector<Tensor> all;
  for (GraphUnit& unit : units_) {
    x = unit(x, graph);
    all.push_back(x);
  }
  return torch::cat(all, 1);
}

const std::vector<std::string>& task_names() {
  static const std::vector<std::string> names = {"joints", "connectivity", "skin"};
  return names;
}

const std::string& name_of(Task task) { return task_names()[static_cast<std::size_t>(task)]; }

std::int64_t RignetOptions::wide(std::int64_t published) const {
  const auto half = static_cast<std::int64_t>(std::llround(0.5 * width * static_cast<double>(published)));
  return std::max(kLeastWidth, 2 * half);
}

void RignetOptions::fields(ConfigFields& f) {
  f("task", task, {{"joints", Task::kJoints}, {"connectivity", Task::kConnectivity}, {"skin", Task::kSkinning}});
  f("width", width, {1e-3, 16.0});
  f("dropout", dropout, {0.0, 0.99});
  f("bandwidth", bandwidth, {1e-4, 1.0});
  f("bones", bones, {1, 64});
  f("mirrored", mirrored);
  f("least_weight", least_weight, {0.0, 1.0});
}

ShapeCodeImpl::ShapeCodeImpl(const RignetOptions& options, std::int64_t width) {
  const std::int64_t first = options.wide(64), second = options.wide(128), third = options.wide(256);
  units_ = register_module("units", GraphStack(std::vector<std::int64_t>{3, first, second, third}));
  whole_ = register_module("whole", DenseStack(std::vector<std::int64_t>{first + second + third, third, width}));
}

Tensor ShapeCodeImpl::forward(const MeshGraph& graph) {
  return run_maxima(whole_(units_(graph.vertices, graph)), graph.starts);
}

}  // namespace anigen::rignet
