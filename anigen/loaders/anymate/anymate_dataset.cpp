#include "anigen/loaders/anymate/anymate_dataset.h"

#include <algorithm>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/progress.h"
#include "anigen/core/random.h"
#include "anigen/io/rigs/anymate_archive.h"
#include "anigen/loaders/converted_assets.h"

namespace anigen::loaders {
namespace {

using models::anymate::AnymateSample;

// A sample with these of its points. @param rows undefined: the first `count`
AnymateSample with_points(const AnymateSample& sample, const torch::Tensor& rows, std::int64_t count) {
  AnymateSample taken = sample;
  const auto take = [&](const torch::Tensor& all) {
    if (!all.defined()) return all;
    return rows.defined() ? all.index_select(0, rows) : all.narrow(0, 0, count);
  };
  taken.points_cloud = take(sample.points_cloud);
  taken.skins_index = take(sample.skins_index);
  taken.skins_weight = take(sample.skins_weight);
  return taken;
}

using Collected = ConvertedAssets<AnymateSample>;

std::shared_ptr<const AnymateDataset> dataset_of(Collected all, const AnymateDatasetOptions& options,
                                                 std::uint64_t seed, const char* purpose) {
  all.report(options.skip_broken, purpose);
  return std::make_shared<const AnymateDataset>(std::move(all.samples), std::move(all.repeat), options.points, seed);
}

std::string size_problem(const AnymateSample& sample, const AnymateDatasetOptions& options) {
  const auto joints = static_cast<std::size_t>(sample.joints.size(0));
  const auto bones = static_cast<std::size_t>(sample.bones.size(0));
  const auto points = static_cast<std::size_t>(sample.points_cloud.size(0));
  if (points < options.points) return std::to_string(points) + " points, fewer than wanted";
  if (bones < options.min_bones || bones > options.max_bones) return std::to_string(bones) + " bones";
  if (joints > options.max_joints) return std::to_string(joints) + " joints";
  if (options.cells && (!sample.vox.defined() || sample.vox.size(0) == 0)) return "no cells inside";
  return "";
}

Collected convert(const std::vector<AssetId>& assets, const AnymateDatasetOptions& options) {
  AnymateConversion conversion;
  conversion.points = options.points;
  conversion.cells = options.cells;
  return convert_assets<AnymateSample>(
      assets, [&](const RiggedItem& item) { return convert_rig(item, conversion); },
      [&](const AnymateSample& sample) { return size_problem(sample, options); });
}

Collected read_shards(const std::vector<std::string>& files, const AnymateDatasetOptions& options) {
  Collected all;
  for (const std::string& file : files) {
    const io::AnymateArchive archive(file);
    Progress progress("reading " + file, archive.names().size(), "samples");
    for (std::size_t i = 0; i < archive.names().size(); ++i) {
      progress.advance();
      try {
        AnymateSample sample = read_anymate_sample(archive.sample(i), archive.names()[i], file);
        const std::string problem = size_problem(sample, options);
        all.add(std::move(sample), 1, archive.names()[i], problem);
      } catch (const InputError& error) {
        all.unreadable.emplace_back(error.what());
      }
    }
    progress.finish();
  }
  return all;
}

}  // namespace

AnymateDatasetOptions AnymateDatasetOptions::read(ConfigReader& reader) {
  AnymateDatasetOptions options;
  options.shards = reader.texts("shards", {});
  options.eval_shards = reader.texts("eval_shards", {});
  options.points = static_cast<std::size_t>(reader.integer("points", 8192, 1, 1 << 20));
  options.min_bones = static_cast<std::size_t>(reader.integer("min_bones", 1, 1, 4096));
  options.max_bones = static_cast<std::size_t>(reader.integer("max_bones", 64, 1, 4096));
  options.max_joints = static_cast<std::size_t>(reader.integer("max_joints", 96, 1, 4096));
  if (options.shards.empty()) {
    options.read_common(reader);
    options.filter.drop_bad_skin = reader.boolean("filter_bad_skin", true);
  } else if (reader.has("data_dir")) {
    throw reader.error("shards", "there are files and a data_dir; give one of them");
  }
  return options;
}

AnymateDataset::AnymateDataset(std::vector<AnymateSample> samples, std::vector<std::size_t> repeat, std::size_t points,
                               std::uint64_t seed)
    : samples_(std::move(samples)), points_(points), seed_(seed) {
  for (std::size_t i = 0; i < samples_.size(); ++i) visits_.insert(visits_.end(), repeat[i], i);
}

AnymateSample AnymateDataset::sample(std::size_t index) const {
  return with_points(samples_[index], {}, static_cast<std::int64_t>(points_));
}

std::unique_ptr<Batch> AnymateDataset::load(const std::vector<Draw>& draws) const {
  auto batch = std::make_unique<AnymateDraws>();
  for (const Draw& draw : draws) {
    const AnymateSample& sample = samples_[visits_[draw.item]];
    const auto all = static_cast<std::size_t>(sample.points_cloud.size(0));
    torch::Tensor rows;
    if (all > points_) {
      std::vector<std::size_t> order = Rng(seed_, "anymate rows", draw.position).permutation(all);
      order.resize(points_);
      rows = torch::tensor(std::vector<std::int64_t>(order.begin(), order.end()));
    }
    batch->samples.push_back(with_points(sample, rows, static_cast<std::int64_t>(points_)));
    batch->ids.push_back(sample.name);
  }
  return batch;
}

AnymateDatasets open_anymate(const AnymateDatasetOptions& options, std::uint64_t seed) {
  AnymateDatasets sets;
  const auto train = [&](Collected all) { sets.train = dataset_of(std::move(all), options, seed, "train on"); };
  const auto hold_out = [&](Collected all) { sets.held_out = dataset_of(std::move(all), options, seed, "hold out"); };
  if (!options.shards.empty()) {
    train(read_shards(options.shards, options));
    if (!options.eval_shards.empty()) hold_out(read_shards(options.eval_shards, options));
    return sets;
  }
  const TrainAndEval assets = select(options);
  train(convert(assets.train, options));
  if (!assets.eval.empty()) hold_out(convert(assets.eval, options));
  return sets;
}

}  // namespace anigen::loaders
