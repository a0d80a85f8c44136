#include "anigen/models/anymate/collate.h"

#include <algorithm>

#include "anigen/core/error.h"
#include "anigen/nn/shape_text.h"

namespace anigen::models::anymate {
namespace {

constexpr double kPadding = -3.0;  // outside of [-1, 1], where nothing is

std::string place_of(const AnymateSample& sample, const char* part) {
  return sample.name.empty() ? part : sample.name + "/" + part;
}

void require_part(bool fits, const AnymateSample& sample, const char* part, const std::string& problem) {
  if (!fits) throw InputError("", place_of(sample, part), problem);
}

void require_matrix(const Tensor& tensor, std::int64_t rows, std::int64_t columns, const AnymateSample& sample,
                    const char* part) {
  const bool fits = tensor.defined() && tensor.dim() == 2 && (rows < 0 || tensor.size(0) == rows) &&
                    (columns < 0 || tensor.size(1) == columns);
  require_part(fits, sample, part, "has shape " + nn::shape_text(tensor) + ", which does not fit");
}

// Rows [count, C] at the top of [rows, C].
Tensor padded(const Tensor& values, std::int64_t rows, const AnymateSample& sample, const char* part) {
  require_matrix(values, -1, -1, sample, part);
  require_part(values.size(0) >= 1 && values.size(0) <= rows, sample, part,
               "has " + std::to_string(values.size(0)) + " rows; from 1 to " + std::to_string(rows) + " are possible");
  return torch::constant_pad_nd(values.to(torch::kCPU, torch::kFloat32), {0, 0, 0, rows - values.size(0)}, kPadding);
}

void require_indices(const Tensor& indices, std::int64_t lowest, std::int64_t count, const AnymateSample& sample,
                     const char* part) {
  require_part(!indices.is_floating_point(), sample, part, "holds indices, which are integers");
  if (indices.numel() == 0) return;
  const bool fits = indices.min().item<std::int64_t>() >= lowest && indices.max().item<std::int64_t>() < count;
  require_part(fits, sample, part,
               "holds an index outside [" + std::to_string(lowest) + ", " + std::to_string(count) + ")");
}

// Whether all samples have a part. @throws InputError when only some have
bool all_have(const std::vector<AnymateSample>& samples, Tensor AnymateSample::*part, const char* name) {
  const bool first = (samples.front().*part).defined();
  for (const AnymateSample& sample : samples) {
    require_part((sample.*part).defined() == first, sample, name,
                 "is there for some samples of a batch and not others");
  }
  return first;
}

// [B, most] with ones for the first counts[b] of each row.
Tensor prefix_mask(const std::vector<std::int64_t>& counts) {
  const std::int64_t most = *std::max_element(counts.begin(), counts.end());
  return torch::arange(most).unsqueeze(0) < torch::tensor(counts, torch::kInt64).unsqueeze(1);
}

Tensor one_hot_parents(const AnymateSample& sample, std::int64_t rows, std::int64_t columns) {
  const std::int64_t count = sample.joints.size(0);
  require_part(sample.conns.dim() == 1 && sample.conns.size(0) == count, sample, "conns", "is not one for each joint");
  require_indices(sample.conns, 0, count, sample, "conns");
  Tensor matrix = torch::zeros({rows, columns});
  const Tensor parents = sample.conns.to(torch::kCPU, torch::kInt64).unsqueeze(1);
  matrix.narrow(0, 0, count).scatter_(1, parents, 1.0);
  return matrix;
}

Tensor dense_skin(const AnymateSample& sample, std::int64_t columns) {
  require_matrix(sample.skins_index, -1, -1, sample, "skins_index");
  require_part(sample.skins_weight.defined() && sample.skins_weight.sizes() == sample.skins_index.sizes(), sample,
               "skins_weight", "has not the shape of skins_index");
  require_indices(sample.skins_index, -1, sample.bones.size(0), sample, "skins_index");
  Tensor index = sample.skins_index.to(torch::kCPU, torch::kInt64).clone();
  index.masked_fill_(index < 0, columns);  // a column more takes what holds nothing
  const Tensor weights = sample.skins_weight.to(torch::kCPU, torch::kFloat64);
  return torch::zeros({index.size(0), columns + 1}, torch::kFloat64).scatter_(1, index, weights).narrow(1, 0, columns);
}

// Stacks make(sample) of all. @throws InputError when shapes differ
template <typename Make>
Tensor stacked(const std::vector<AnymateSample>& samples, const char* part, const Make& make) {
  std::vector<Tensor> items;
  for (const AnymateSample& sample : samples) {
    items.push_back(make(sample));
    require_part(
        items.back().sizes() == items.front().sizes(), sample, part,
        "has shape " + nn::shape_text(items.back()) + ", the first sample's has " + nn::shape_text(items.front()));
  }
  return torch::stack(items);
}

// What both kinds of batches hold.
AnymateBatch positions_of(const std::vector<AnymateSample>& samples, const CollateOptions& options) {
  if (samples.empty()) throw InputError("", "samples", "there is nothing to collate");
  AnymateBatch batch;
  for (const AnymateSample& sample : samples) {
    require_matrix(sample.joints, -1, 3, sample, "joints");
    require_matrix(sample.bones, -1, 6, sample, "bones");
    batch.names.push_back(sample.name);
    batch.joints_num.push_back(sample.joints.size(0));
    batch.bones_num.push_back(sample.bones.size(0));
  }
  batch.joints = stacked(samples, "joints",
                         [&](const AnymateSample& s) { return padded(s.joints, options.max_joints, s, "joints"); });
  batch.bones =
      stacked(samples, "bones", [&](const AnymateSample& s) { return padded(s.bones, options.max_bones, s, "bones"); });
  if (all_have(samples, &AnymateSample::points_cloud, "pc")) {
    batch.points_cloud = stacked(samples, "pc", [](const AnymateSample& s) {
      require_matrix(s.points_cloud, -1, 6, s, "pc");
      return s.points_cloud.to(torch::kCPU, torch::kFloat32);
    });
  }
  if (all_have(samples, &AnymateSample::vox, "vox")) {
    for (const AnymateSample& sample : samples) {
      require_matrix(sample.vox, -1, 3, sample, "vox");
      batch.vox.push_back(sample.vox);
    }
  }
  return batch;
}

}  // namespace

AnymateBatch collate(const std::vector<AnymateSample>& samples, const CollateOptions& options) {
  AnymateBatch batch = positions_of(samples, options);
  batch.joints_mask = prefix_mask(batch.joints_num);
  batch.bones_mask = prefix_mask(batch.bones_num);
  if (all_have(samples, &AnymateSample::conns, "conns")) {
    const std::int64_t columns = batch.joints_mask.size(1);
    batch.conns = stacked(samples, "conns",
                          [&](const AnymateSample& s) { return one_hot_parents(s, options.max_joints, columns); });
  }
  if (all_have(samples, &AnymateSample::skins_index, "skins_index")) {
    const std::int64_t columns = batch.bones_mask.size(1);
    batch.skins = stacked(samples, "skins_index", [&](const AnymateSample& s) { return dense_skin(s, columns); });
  }
  return batch;
}

AnymateBatch collate_diffusion(const std::vector<AnymateSample>& samples, std::int64_t points,
                               const CollateOptions& options) {
  if (points <= 0) throw InputError("", "num_training_points", "must be positive");
  AnymateBatch batch = positions_of(samples, options);
  batch.joints_repeat = stacked(samples, "joints", [points](const AnymateSample& s) {
    const Tensor turn = torch::arange(points).remainder(s.joints.size(0));
    return s.joints.to(torch::kCPU, torch::kFloat32).index_select(0, turn);
  });
  return batch;
}

}  // namespace anigen::models::anymate
