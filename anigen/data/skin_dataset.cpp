#include "anigen/data/skin_dataset.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <optional>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"
#include "anigen/geometry/sampling.h"

namespace anigen::data {

SkinDatasetOptions SkinDatasetOptions::read(ConfigReader& reader) {
  SkinDatasetOptions options;
  options.read_common(reader);
  options.memory_budget_mb = reader.integer("memory_budget_mb", 8192, 0, 1 << 24);
  options.filter.read_rigged(reader);
  if (reader.boolean("skin_accum_as_flow", false))
    throw NotSupportedError(reader.file(), reader.pointer_to("skin_accum_as_flow"), "skin_accum_as_flow");
  for (const char* unused :
       {"image_size", "model", "resolution", "load_cubvh", "skl_dilation_iter", "skl_dilation_random_aug",
        "skl_dilation_random_aug_prob", "joint_merge_res", "bucket_by_voxels"}) {
    reader.raw(unused);
  }
  return options;
}

namespace {

// 1 − the largest weight at the middle of the face; `scratch` [joints] is zero before and after.
double blend_of(const RiggedItem& item, const Triangle& face, std::vector<float>& scratch) {
  float largest = 0.0f;
  for (const std::int32_t vertex : face) {
    const Influence* row = item.skin.row(static_cast<std::size_t>(vertex));
    for (std::size_t i = 0; i < item.skin.row_size(static_cast<std::size_t>(vertex)); ++i)
      largest = std::max(largest, scratch[static_cast<std::size_t>(row[i].joint)] += row[i].weight);
  }
  for (const std::int32_t vertex : face) {
    const Influence* row = item.skin.row(static_cast<std::size_t>(vertex));
    for (std::size_t i = 0; i < item.skin.row_size(static_cast<std::size_t>(vertex)); ++i)
      scratch[static_cast<std::size_t>(row[i].joint)] = 0.0f;
  }
  // Rounding leaves about 1e-7 of blend on a rigid face.
  const double blend = 1.0 - largest / 3.0;
  return blend > 1e-5 ? blend : 0.0;
}

bool accumulate_and_normalize(std::vector<double>& values) {
  double sum = 0.0;
  for (double& value : values) value = sum += value;
  if (!(sum > 0.0)) return false;
  for (double& value : values) value /= sum;
  return true;
}

constexpr std::size_t kReadTogether = 64;

torch::Tensor parents_tensor(const std::vector<int>& parents) {
  torch::Tensor tensor = torch::empty({static_cast<std::int64_t>(parents.size())}, torch::kInt64);
  std::copy(parents.begin(), parents.end(), tensor.data_ptr<std::int64_t>());
  return tensor;
}

// Zeros, filled by this very thread: torch::zeros would start a team of threads in every loading thread.
torch::Tensor zero_weights(std::size_t rows, std::size_t joints) {
  torch::Tensor tensor = torch::empty({static_cast<std::int64_t>(rows), static_cast<std::int64_t>(joints)});
  std::fill_n(tensor.data_ptr<float>(), rows * joints, 0.0f);
  return tensor;
}

}  // namespace

SkinSampler::SkinSampler(const RiggedItem& item, bool with_blends)
    : areas_(geometry::face_probabilities(item.vertices, item.faces)) {
  if (with_blends) {
    std::vector<float> scratch(item.joints.size(), 0.0f);
    blends_.resize(areas_.size());
    for (std::size_t f = 0; f < areas_.size(); ++f) blends_[f] = areas_[f] * blend_of(item, item.faces[f], scratch);
    if (!accumulate_and_normalize(blends_)) blends_.clear();
  }
  accumulate_and_normalize(areas_);
}

geometry::SurfacePoint SkinSampler::draw(double blend_share, Rng& rng) const {
  const double which = rng.uniform(), place = rng.uniform(), u = rng.uniform(), v = rng.uniform();
  const std::vector<double>& sums = which < blend_share && !blends_.empty() ? blends_ : areas_;
  const auto found = std::upper_bound(sums.begin(), sums.end(), place);
  const double root = std::sqrt(u);
  geometry::SurfacePoint point;
  point.face = static_cast<std::int32_t>(
      std::min<std::ptrdiff_t>(found - sums.begin(), static_cast<std::ptrdiff_t>(sums.size()) - 1));
  point.barycentric = {1.0 - root, root * (1.0 - v), root * v};
  return point;
}

void add_weights_at(const RiggedItem& item, const geometry::SurfacePoint& point, const std::vector<int>& joint_of,
                    float* out) {
  const Triangle& face = item.faces[static_cast<std::size_t>(point.face)];
  for (int corner = 0; corner < 3; ++corner) {
    const auto vertex = static_cast<std::size_t>(face[static_cast<std::size_t>(corner)]);
    const auto share = static_cast<float>(point.barycentric[corner]);
    const Influence* row = item.skin.row(vertex);
    for (std::size_t i = 0; i < item.skin.row_size(vertex); ++i)
      out[joint_of[static_cast<std::size_t>(row[i].joint)]] += share * row[i].weight;
  }
}

/// An asset with what is derived from it once.
struct SkinDataset::Entry {
  RiggedItem item;
  SkinSampler sampler;
  std::vector<int> order;  // parents first
  std::vector<bool> used;  // joints with weight anywhere

  Entry(RiggedItem read, bool with_blends)
      : item(std::move(read)),
        sampler(item, with_blends),
        order(parents_first_order(item.parents, item.id)),
        used(item.joints.size(), false) {
    for (const Influence& influence : item.skin.influences) used[static_cast<std::size_t>(influence.joint)] = true;
  }
  std::uintmax_t bytes() const { return item.bytes() + sampler.bytes() + order.size() * sizeof(int); }
};

SkinDataset::SkinDataset(std::vector<AssetId> assets, const Options& options, const SkinDataset* earlier)
    : options_(options) {
  std::map<std::filesystem::path, std::shared_ptr<const Entry>> known;
  for (std::size_t i = 0; earlier != nullptr && i < earlier->assets_.size(); ++i)
    known.emplace(rig_path(earlier->assets_[i]), earlier->entries_[i]);
  std::vector<std::string> errors;
  std::uintmax_t used = 0;
  std::size_t unweighted = 0, touched = 0;  // vertices, and assets that have such
  std::optional<Progress> progress;
  if (earlier == nullptr) progress.emplace("reading rigs", assets.size(), "assets");  // else a training is under way
  for (std::size_t first = 0; first < assets.size(); first += kReadTogether) {
    const std::size_t count = std::min(kReadTogether, assets.size() - first);
    std::vector<std::shared_ptr<const Entry>> read(count);
    std::vector<std::string> problems(count);
    if (used < options.memory_budget) {
      parallel_for(count, [&](std::size_t i) {
        const auto found = known.find(rig_path(assets[first + i]));
        if (found != known.end()) read[i] = found->second;
        if (read[i]) return;
        try {
          read[i] =
              std::make_shared<Entry>(read_rigged_item(assets[first + i]), options_.augmentations.blend_sampling > 0.0);
        } catch (const InputError& error) {
          problems[i] = error.what();
        }
      });
    }
    for (std::size_t i = 0; i < count; ++i) {
      if (progress) progress->advance();
      if (!problems[i].empty()) {
        errors.push_back(problems[i]);
        continue;
      }
      if (read[i] && read[i]->item.unweighted > 0) {
        unweighted += read[i]->item.unweighted;
        ++touched;
      }
      if (read[i]) used += read[i]->bytes();
      if (used > options.memory_budget) read[i] = nullptr;
      visits_.insert(visits_.end(), assets[first + i].repeat, assets_.size());
      assets_.push_back(assets[first + i]);
      entries_.push_back(read[i]);
    }
  }
  if (progress) progress->finish();
  if (unweighted > 0)
    log::warn("{} vertices of {} assets have no weight and follow joint 0, as published", unweighted, touched);
  report_broken(errors, assets.size(), options.skip_broken);
}

std::shared_ptr<const SkinDataset::Entry> SkinDataset::entry(std::size_t index) const {
  if (entries_[index]) return entries_[index];
  return std::make_shared<Entry>(read_rigged_item(assets_[index]), options_.augmentations.blend_sampling > 0.0);
}

std::shared_ptr<const RiggedItem> SkinDataset::item(std::size_t index) const {
  const std::shared_ptr<const Entry> found = entry(index);
  return {found, &found->item};
}

std::unique_ptr<Batch> SkinDataset::load(const std::vector<Draw>& draws) const {
  auto batch = std::make_unique<SkinBatch>();
  for (const Draw& draw : draws) sample(visits_[draw.item], draw.position, *batch);
  return batch;
}

void SkinDataset::sample(std::size_t index, std::uint64_t position, SkinBatch& batch) const {
  const std::shared_ptr<const Entry> found = entry(index);
  const Augmentations& augmentations = options_.augmentations;
  Rng rng(options_.seed, "skin sample", position);
  const RigDraw rig = augment(found->item.joints, found->item.parents, found->order, found->used, augmentations, rng);
  const float power = augmentations.sharpen > 0.0
                          ? static_cast<float>(std::exp(rng.uniform(-augmentations.sharpen, augmentations.sharpen)))
                          : 1.0f;
  const bool vertices = options_.num_skin_samples == 0;
  const std::size_t rows = vertices ? found->item.vertices.size() : static_cast<std::size_t>(options_.num_skin_samples);
  const std::size_t joints = rig.joints.size();
  torch::Tensor skin = zero_weights(rows, joints);
  float* out = skin.data_ptr<float>();
  for (std::size_t row = 0; row < rows; ++row, out += joints) {
    if (vertices) {
      const Influence* influences = found->item.skin.row(row);
      for (std::size_t i = 0; i < found->item.skin.row_size(row); ++i)
        out[rig.joint_of[static_cast<std::size_t>(influences[i].joint)]] += influences[i].weight;
    } else {
      add_weights_at(found->item, found->sampler.draw(augmentations.blend_sampling, rng), rig.joint_of, out);
    }
    if (power != 1.0f) sharpen(out, joints, power);
  }
  batch.ids.push_back(found->item.id);
  batch.joints.push_back(points_tensor(rig.joints));
  batch.parents.push_back(parents_tensor(rig.parents));
  batch.skin.push_back(skin);
}

std::unique_ptr<SkinBatch> SkinDataset::vertices_of(std::size_t index, std::size_t most) const {
  const std::shared_ptr<const Entry> found = entry(index);
  const RiggedItem& item = found->item;
  const std::size_t all = item.vertices.size(), count = most == 0 ? all : std::min(most, all);
  const std::size_t joints = item.joints.size();
  auto batch = std::make_unique<SkinBatch>();
  torch::Tensor skin = zero_weights(count, joints);
  float* out = skin.data_ptr<float>();
  for (std::size_t i = 0; i < count; ++i, out += joints) {
    const std::size_t vertex = i * all / count;
    const Influence* row = item.skin.row(vertex);
    for (std::size_t k = 0; k < item.skin.row_size(vertex); ++k) out[row[k].joint] += row[k].weight;
  }
  batch->ids.push_back(item.id);
  batch->joints.push_back(points_tensor(item.joints));
  batch->parents.push_back(parents_tensor(item.parents));
  batch->skin.push_back(skin);
  return batch;
}

}  // namespace anigen::data
