#include "anigen/data/skin_correction_dataset.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <map>
#include <set>
#include <system_error>
#include <utility>

#include "anigen/asset/skeleton.h"
#include "anigen/core/config_fields.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"
#include "anigen/core/process.h"
#include "anigen/core/random.h"
#include "anigen/data/rigged_item.h"
#include "anigen/io/arrays/npz.h"

namespace anigen::data {

namespace {

namespace fs = std::filesystem;
using rigging::kSkinAssetFeatures;
using rigging::kSkinPairFeatures;

constexpr std::size_t kBoundTogether = 4;  // assets: each takes threads and up to 2 GiB of its own
const char* const kArrays[] = {"made_by", "joints", "features", "asset", "truth", "missed"};

io::NdArray halves_of(const std::vector<float>& values, std::vector<std::int64_t> shape) {
  io::NdArray array;
  array.dtype = io::Dtype::kF16;
  array.shape = std::move(shape);
  array.bytes.reserve(2 * values.size());
  for (const float value : values) {
    const std::uint16_t half = io::float_to_half(value);
    array.bytes.push_back(static_cast<std::uint8_t>(half & 0xFF));
    array.bytes.push_back(static_cast<std::uint8_t>(half >> 8));
  }
  return array;
}

std::vector<std::uint16_t> bits_of(const io::NdArray& halves) {
  std::vector<std::uint16_t> bits(halves.bytes.size() / 2);
  for (std::size_t i = 0; i < bits.size(); ++i)
    bits[i] = static_cast<std::uint16_t>(halves.bytes[2 * i] | halves.bytes[2 * i + 1] << 8);
  return bits;
}

}  // namespace

/// An asset's kept vertices.
struct SkinCorrectionDataset::Example {
  std::size_t rows = 0, candidates = 0;
  std::vector<std::int32_t> joints;     // [N, K], −1: no candidate
  std::vector<std::uint16_t> features;  // [N, K, F] as halves
  std::array<float, kSkinAssetFeatures> asset{};
  std::vector<float> truth;   // [N, K]
  std::vector<float> missed;  // [N]
};

namespace {

// All that decides the contents of a file of features.
std::vector<std::int64_t> cache_settings(const AssetId& asset, const SkinCorrectionDataOptions& options) {
  const std::uint64_t rig = stable_hash(read_file(rig_path(asset)));
  return {rigging::kSkinFeatureVersion,         static_cast<std::int64_t>(options.features.candidates),
          options.features.resolution,          static_cast<std::int64_t>(options.cached_vertices),
          static_cast<std::int64_t>(rig >> 32), static_cast<std::int64_t>(rig & 0xFFFFFFFF)};
}

fs::path features_path(const AssetId& asset, const SkinCorrectionDataOptions& options) {
  return asset.root / options.cache / (asset.id + ".npz");
}

// The rig as binding wants it: parents before children.
struct OrderedRig {
  Mesh mesh;
  Skeleton skeleton;
  SkinWeights skin;  // of these joints
};

OrderedRig ordered_rig(RiggedItem item) {
  const std::vector<int> order = parents_first_order(item.parents, item.id);
  std::vector<int> place(order.size()), parents;
  std::vector<Eigen::Vector3d> positions;
  for (std::size_t i = 0; i < order.size(); ++i) place[at(order[i])] = static_cast<int>(i);
  for (const int joint : order) {
    const int parent = item.parents[at(joint)];
    parents.push_back(parent < 0 ? -1 : place[at(parent)]);
    positions.push_back(item.joints[at(joint)].cast<double>());
  }
  OrderedRig rig;
  rig.mesh.vertices = std::move(item.vertices);
  rig.mesh.faces = std::move(item.faces);
  rig.skeleton = skeleton_from_joints(positions, parents);
  rig.skin = std::move(item.skin);
  for (Influence& influence : rig.skin.influences) influence.joint = place[at(influence.joint)];
  return rig;
}

// Vertices whose features are kept, ascending; the choice depends on their number alone.
std::vector<std::size_t> kept_vertices(std::size_t all, std::size_t most) {
  std::vector<std::size_t> kept = Rng(0, "skin features", all).permutation(all);
  if (most > 0 && most < all) kept.resize(most);
  std::sort(kept.begin(), kept.end());
  return kept;
}

io::NamedArrays compute_features(const AssetId& asset, const SkinCorrectionDataOptions& options) {
  const OrderedRig rig = ordered_rig(read_rigged_item(asset));
  const rigging::SkinFeatures features(rig.mesh, rig.skeleton, options.features);
  const std::vector<std::size_t> vertices = kept_vertices(rig.mesh.vertices.size(), options.cached_vertices);
  std::vector<std::int32_t> places;
  for (const std::size_t vertex : vertices) places.push_back(features.place_of_vertex()[vertex]);
  const rigging::SkinPairs pairs = features.pairs(places);
  const std::size_t count = features.candidates();
  std::vector<float> truth(places.size() * count, 0.0F), missed(places.size(), 0.0F);
  for (std::size_t n = 0; n < vertices.size(); ++n) {
    const auto first = pairs.joints.begin() + static_cast<std::ptrdiff_t>(n * count);
    const auto last = first + static_cast<std::ptrdiff_t>(count);
    for (std::size_t i = 0; i < rig.skin.row_size(vertices[n]); ++i) {
      const Influence& influence = rig.skin.row(vertices[n])[i];
      const auto found = std::find(first, last, influence.joint);
      float& to = found == last ? missed[n] : truth[n * count + static_cast<std::size_t>(found - first)];
      to += influence.weight;
    }
  }
  const auto n = static_cast<std::int64_t>(places.size()), k = static_cast<std::int64_t>(count);
  const std::vector<std::int64_t> settings = cache_settings(asset, options);
  return {
      {kArrays[0], io::NdArray::from(settings, {static_cast<std::int64_t>(settings.size())})},
      {kArrays[1], io::NdArray::from(pairs.joints, {n, k})},
      {kArrays[2], halves_of(pairs.features, {n, k, static_cast<std::int64_t>(kSkinPairFeatures)})},
      {kArrays[3], io::NdArray::from(std::vector<float>(features.asset().begin(), features.asset().end()),
                                     {static_cast<std::int64_t>(kSkinAssetFeatures)})},
      {kArrays[4], io::NdArray::from(truth, {n, k})},
      {kArrays[5], io::NdArray::from(missed, {n})},
  };
}

// Null when there is none, or it was made otherwise or is damaged.
std::optional<io::NamedArrays> cached_features(const AssetId& asset, const SkinCorrectionDataOptions& options) {
  const fs::path file = features_path(asset, options);
  const std::vector<std::int64_t> wanted = cache_settings(asset, options);
  std::error_code error;
  if (!fs::exists(file, error)) return {};
  try {
    io::NamedArrays arrays = io::read_npz(file, {std::begin(kArrays), std::end(kArrays)});
    const auto shape = [&](int array) { return io::find(arrays, kArrays[array])->shape; };
    const std::vector<std::int64_t> pairs = shape(1);
    const auto features = static_cast<std::int64_t>(kSkinPairFeatures);
    if (io::find(arrays, kArrays[0])->as<std::int64_t>() != wanted || pairs.size() != 2 || pairs[0] < 1) return {};
    const bool fits = pairs[1] == wanted[1] && shape(2) == std::vector<std::int64_t>{pairs[0], pairs[1], features} &&
                      io::find(arrays, kArrays[2])->dtype == io::Dtype::kF16 && shape(4) == pairs &&
                      shape(3) == std::vector<std::int64_t>{static_cast<std::int64_t>(kSkinAssetFeatures)} &&
                      shape(5) == std::vector<std::int64_t>{pairs[0]};
    if (fits) return arrays;
  } catch (const InputError& problem) {
    log::debug("made again: {}", problem.what());
  }
  return {};
}

// The floor of classical weights inside logarithms, for weights that a sample does not see.
float unseen_log() { return static_cast<float>(std::log(rigging::kClassicalFloor)); }

// The features that a sample does not see: those of one classical method, or none.
std::vector<rigging::SkinPairFeature> draw_unseen(const SkinCorrectionDataOptions& options, Rng& rng) {
  const bool drops = rng.chance(options.drop_classical), heat = rng.chance(0.5);
  if (!drops) return {};
  if (heat) return {rigging::kHeatLog, rigging::kHeatAround};
  return {rigging::kGeodesicLog, rigging::kGeodesicAround};
}

void check_number(const std::string& text, const std::string& file, const std::string& place) {
  const bool digits = !text.empty() && text.size() < 6 && text.find_first_not_of("0123456789") == std::string::npos;
  if (!digits) throw InputError(file, place, "is no fold \"i/n\", such as 0/5");
}

// Visits of a group of assets, in turn, until there are `count`.
void append_visits(const std::vector<std::size_t>& group, std::size_t count, std::vector<std::size_t>& visits) {
  for (std::size_t i = 0; i < count; ++i) visits.push_back(group[i % group.size()]);
}

}  // namespace

SkeletonFold SkeletonFold::parse(const std::string& text, const std::string& file, const std::string& place) {
  const std::size_t slash = text.find('/');
  const std::string index = text.substr(0, slash), count = slash == std::string::npos ? "" : text.substr(slash + 1);
  check_number(index, file, place);
  check_number(count, file, place);
  SkeletonFold fold;
  fold.index = std::stoul(index);
  fold.count = std::stoul(count);
  if (fold.count < 2 || fold.index >= fold.count)
    throw InputError(file, place, "\"" + text + "\": of n folds, at least 2, the first is 0 and the last n - 1");
  return fold;
}

bool SkeletonFold::holds(const std::string& signature) const {
  return stable_hash("out of fold " + signature) % count == index;
}

std::string skeleton_signature_of(const AssetId& asset) {
  const fs::path file = rig_path(asset);
  const io::NamedArrays arrays = io::read_npz(file, {"parents"});
  const auto parents = io::find(arrays, "parents")->as<std::int32_t>();
  const std::vector<int> own(parents.begin(), parents.end());
  parents_first_order(own, file.string());  // refuses what is no tree
  return tree_signature(own);
}

bool is_real(const AssetId& asset) { return asset.source.rfind("procedural:", 0) != 0; }

SkinCorrectionDataOptions SkinCorrectionDataOptions::read(ConfigReader& reader) {
  SkinCorrectionDataOptions options;
  options.sources.read_common(reader);
  ConfigFields f(reader);
  f("candidates", options.features.candidates, {1, 256});
  f("geovoxel_resolution", options.features.resolution, {2, 512});
  f("cached_vertices", options.cached_vertices, {0, 1 << 24});
  f("vertices", options.vertices, {1, 1 << 20});
  f("real_share", options.real_share, FieldRange<double>{0.0, 1.0});
  f("fold", options.fold);
  f("bad_skeletons", options.bad_skeletons);
  f("cache", options.cache);
  f("even_skeletons", options.even_skeletons);
  f("drop_classical", options.drop_classical, {0.0, 1.0});
  options.sources.filter.drop_bad_skeleton = !options.bad_skeletons;
  options.sources.filter.drop_bad_skin = true;
  if (options.cache.empty()) throw reader.error("cache", "name a folder for the features");
  if (options.fold.empty()) return options;
  SkeletonFold::parse(options.fold, reader.file(), reader.pointer_to("fold"));
  if (options.sources.eval_fraction > 0.0 || options.sources.train_share < 1.0)
    throw reader.error("fold", "goes neither with eval_fraction nor with train_share");
  return options;
}

SkinCorrectionDataset::SkinCorrectionDataset(std::vector<AssetId> assets, const SkinCorrectionDataOptions& options,
                                             std::uint64_t seed, bool training)
    : options_(options), seed_(seed), training_(training) {
  read_all(std::move(assets));
  arrange_visits(training);
}

SkinCorrectionDataset::~SkinCorrectionDataset() = default;

void SkinCorrectionDataset::read_all(std::vector<AssetId> assets) {
  std::vector<std::string> problems(assets.size());
  std::vector<std::shared_ptr<const Example>> examples(assets.size());
  Progress progress("skin features", assets.size(), "assets");
  std::atomic<std::size_t> next{0};
  const auto read_one = [&](std::size_t i) {
    std::optional<io::NamedArrays> arrays = cached_features(assets[i], options_);
    if (!arrays) {
      arrays = compute_features(assets[i], options_);
      io::write_npz(features_path(assets[i], options_), *arrays);
    }
    auto example = std::make_shared<Example>();
    example->joints = io::find(*arrays, kArrays[1])->as<std::int32_t>();
    example->features = bits_of(*io::find(*arrays, kArrays[2]));
    const std::vector<float> asset = io::find(*arrays, kArrays[3])->as<float>();
    std::copy(asset.begin(), asset.end(), example->asset.begin());
    example->truth = io::find(*arrays, kArrays[4])->as<float>();
    example->missed = io::find(*arrays, kArrays[5])->as<float>();
    example->rows = example->missed.size();
    example->candidates = options_.features.candidates;
    examples[i] = std::move(example);
  };
  parallel_for(std::min(kBoundTogether, at(thread_count())), [&](std::size_t) {
    for (std::size_t i = next++; i < assets.size() && !interrupt_requested(); i = next++) {
      try {
        read_one(i);
      } catch (const WriteError&) {
        throw;
      } catch (const Interrupted&) {
        throw;
      } catch (const Error& error) {
        problems[i] = assets[i].id + ": " + error.what();
      }
      progress.advance();
    }
  });
  progress.finish();
  throw_if_interrupted();
  std::vector<std::string> named;
  double missed = 0.0, rows = 0.0;
  for (std::size_t i = 0; i < assets.size(); ++i) {
    if (!problems[i].empty()) {
      named.push_back(problems[i]);
      continue;
    }
    for (const float share : examples[i]->missed) missed += static_cast<double>(share);
    rows += static_cast<double>(examples[i]->rows);
    assets_.push_back(std::move(assets[i]));
    examples_.push_back(std::move(examples[i]));
  }
  report_broken(named, assets.size(), options_.sources.skip_broken);
  log::info("{:.3f} % of the true weights of {:.0f} vertices is on joints that are no candidates",
            100.0 * missed / rows, rows);
}

void SkinCorrectionDataset::arrange_visits(bool training) {
  std::vector<std::size_t> real, drawn;
  for (std::size_t i = 0; i < assets_.size(); ++i) {
    std::vector<std::size_t>& group = is_real(assets_[i]) ? real : drawn;
    group.insert(group.end(), training ? assets_[i].repeat : 1, i);
  }
  if (training && options_.real_share && (real.empty() || drawn.empty())) {
    log::warn("real_share has no effect: all assets to train on are {}", real.empty() ? "creatures" : "real rigs");
  } else if (training && options_.real_share) {
    return share_visits(options_.even_skeletons ? evenly_by_skeleton(real) : real, drawn, *options_.real_share);
  }
  visits_ = real;
  visits_.insert(visits_.end(), drawn.begin(), drawn.end());
}

// Real rigs so that every joint tree comes once in each round, with another of its rigs in turn; as many rounds as the
// commonest tree has rigs, so that none is left out.
std::vector<std::size_t> SkinCorrectionDataset::evenly_by_skeleton(const std::vector<std::size_t>& real) const {
  constexpr std::size_t kMostVisits = std::size_t{1} << 24;
  std::map<std::string, std::vector<std::size_t>> by_tree;
  for (const std::size_t i : real) by_tree[skeleton_signature_of(assets_[i])].push_back(i);
  std::size_t commonest = 0;
  for (const auto& tree : by_tree) commonest = std::max(commonest, tree.second.size());
  const std::size_t rounds = std::min(commonest, std::max<std::size_t>(1, kMostVisits / by_tree.size()));
  if (rounds < commonest)
    log::warn("even_skeletons: of {} rigs of one joint tree only {} are trained on", commonest, rounds);
  std::vector<std::size_t> even;
  for (std::size_t round = 0; round < rounds; ++round) {
    for (const auto& tree : by_tree) even.push_back(tree.second[round % tree.second.size()]);
  }
  return even;
}

void SkinCorrectionDataset::share_visits(const std::vector<std::size_t>& real, const std::vector<std::size_t>& drawn,
                                         double share) {
  // The epoch visits each asset of both groups at least once, unless its share is 0.
  std::size_t reals = share > 0.0 ? real.size() : 0, others = share < 1.0 ? drawn.size() : 0;
  if (share > 0.0 && share < 1.0) {
    const double ratio = share / (1.0 - share), all = static_cast<double>(others);
    const auto wanted = static_cast<std::size_t>(std::llround(ratio * all));
    if (wanted >= reals) {
      reals = wanted;
    } else {
      others = std::max(others, static_cast<std::size_t>(std::llround(static_cast<double>(reals) / ratio)));
    }
  }
  if (reals > 0) append_visits(real, reals, visits_);
  if (others > 0) append_visits(drawn, others, visits_);
}

std::unique_ptr<SkinCorrectionBatch> SkinCorrectionDataset::batch_of(std::size_t rows) const {
  const auto n = static_cast<std::int64_t>(rows), k = static_cast<std::int64_t>(options_.features.candidates);
  auto batch = std::make_unique<SkinCorrectionBatch>();
  batch->pairs = torch::empty({n, k, static_cast<std::int64_t>(kSkinPairFeatures)});
  batch->assets = torch::empty({n, static_cast<std::int64_t>(kSkinAssetFeatures)});
  batch->present = torch::empty({n, k}, torch::kBool);
  batch->truth = torch::empty({n, k});
  batch->missed = torch::empty({n});
  return batch;
}

void SkinCorrectionDataset::put(const Example& example, const std::vector<std::size_t>& rows, std::size_t first,
                                SkinCorrectionBatch& batch) const {
  const std::size_t count = example.candidates, width = count * kSkinPairFeatures;
  float* pairs = batch.pairs.data_ptr<float>() + first * width;
  float* assets = batch.assets.data_ptr<float>() + first * kSkinAssetFeatures;
  bool* present = batch.present.data_ptr<bool>() + first * count;
  float* truth = batch.truth.data_ptr<float>() + first * count;
  float* missed = batch.missed.data_ptr<float>() + first;
  for (const std::size_t row : rows) {
    for (std::size_t i = 0; i < width; ++i) *pairs++ = io::half_to_float(example.features[row * width + i]);
    assets = std::copy(example.asset.begin(), example.asset.end(), assets);
    for (std::size_t c = 0; c < count; ++c) *present++ = example.joints[row * count + c] >= 0;
    truth = std::copy_n(&example.truth[row * count], count, truth);
    *missed++ = example.missed[row];
  }
}

std::unique_ptr<Batch> SkinCorrectionDataset::load(const std::vector<Draw>& draws) const {
  auto batch = batch_of(draws.size() * options_.vertices);
  const std::size_t count = options_.features.candidates;
  for (std::size_t d = 0; d < draws.size(); ++d) {
    const std::size_t index = visits_[draws[d].item], first = d * options_.vertices;
    const Example& example = *examples_[index];
    Rng rng(seed_, "skin correction", draws[d].position);
    std::vector<std::size_t> rows(options_.vertices);
    for (std::size_t& row : rows) row = rng.index(example.rows);
    put(example, rows, first, *batch);
    batch->ids.push_back(assets_[index].id);
    if (!training_) continue;
    const std::vector<rigging::SkinPairFeature> unseen = draw_unseen(options_, rng);
    float* pair = batch->pairs.data_ptr<float>() + first * count * kSkinPairFeatures;
    for (std::size_t i = 0; i < options_.vertices * count; ++i, pair += kSkinPairFeatures) {
      for (const rigging::SkinPairFeature feature : unseen) pair[feature] = unseen_log();
    }
  }
  return batch;
}

std::unique_ptr<SkinCorrectionBatch> SkinCorrectionDataset::all_of(std::size_t asset) const {
  const Example& example = *examples_[asset];
  std::vector<std::size_t> rows(example.rows);
  for (std::size_t row = 0; row < rows.size(); ++row) rows[row] = row;
  auto batch = batch_of(rows.size());
  put(example, rows, 0, *batch);
  batch->ids.push_back(assets_[asset].id);
  return batch;
}

namespace {

// Ids of a split file; none where no file is named.
std::set<std::string> ids_of_split(const std::string& split, const std::string& data_dir) {
  return split.empty() ? std::set<std::string>() : read_split(file_of_dataset(split, data_dir), data_dir);
}

// Real rigs by fold, and creatures by split.
TrainAndEval select_fold(const SkinCorrectionDataOptions& options) {
  const SkeletonFold fold = SkeletonFold::parse(options.fold);
  const SourceOptions& sources = options.sources;
  std::vector<AssetId> all = select_assets(sources.data_dir, sources.filter);
  std::vector<char> held_out(all.size(), 0);
  parallel_for(all.size(), [&](std::size_t i) {
    if (is_real(all[i])) held_out[i] = fold.holds(skeleton_signature_of(all[i])) ? 1 : 0;
  });
  const std::set<std::string> trained = ids_of_split(sources.split, sources.data_dir);
  const std::set<std::string> kept = ids_of_split(sources.eval_split, sources.data_dir);
  TrainAndEval chosen;
  chosen.roots = sources.data_dir;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (held_out[i] != 0) {
      chosen.eval.push_back(all[i]);
      chosen.eval.back().repeat = 1;
    } else if (is_real(all[i]) || ((trained.empty() || trained.count(all[i].id) > 0) && kept.count(all[i].id) == 0 &&
                                   kept.count(all[i].variant_of) == 0)) {
      chosen.train.push_back(all[i]);
    }
  }
  if (chosen.eval.empty() || chosen.train.empty()) {
    throw InputError(
        options.sources.data_dir, "fold",
        "fold " + options.fold + (chosen.eval.empty() ? " holds no skeleton out" : " leaves none to train on"));
  }
  return chosen;
}

}  // namespace

Datasets open_skin_corrections(ConfigReader& args, std::uint64_t seed) {
  const SkinCorrectionDataOptions options = SkinCorrectionDataOptions::read(args);
  args.finish();
  Datasets datasets;
  std::vector<AssetId> held_out;
  if (options.fold.empty()) {
    TrainingData data =
        open_training(options.sources, [options, seed](std::vector<AssetId> chosen, const BatchSource*) {
          return std::make_shared<SkinCorrectionDataset>(std::move(chosen), options, seed, true);
        });
    datasets.train = data.train;
    held_out = std::move(data.eval);
  } else {
    TrainAndEval chosen = select_fold(options);
    refuse_test_creatures(chosen, options.sources);
    datasets.train = std::make_shared<const SkinCorrectionDataset>(std::move(chosen.train), options, seed, true);
    held_out = std::move(chosen.eval);
  }
  if (!held_out.empty())
    datasets.eval = std::make_shared<const SkinCorrectionDataset>(std::move(held_out), options, seed, false);
  return datasets;
}

}  // namespace anigen::data
