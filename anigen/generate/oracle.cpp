#include "anigen/generate/oracle.h"

#include <algorithm>
#include <functional>
#include <set>
#include <system_error>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/lease.h"
#include "anigen/core/log.h"
#include "anigen/core/numeric.h"
#include "anigen/core/process.h"
#include "anigen/core/version.h"
#include "anigen/data/metadata.h"
#include "anigen/data/voxel_files.h"
#include "anigen/generate/asset_maker.h"
#include "anigen/io/gltf/gltf.h"

namespace anigen::generate {

namespace {

namespace fs = std::filesystem;
using sparse_structure::VoxelPair;
using torch::Tensor;

constexpr const char *kStageTwo = "stage 2", *kStageFour = "stage 4";
constexpr const char *kAutoEncoder = kOracleRows[0], *kTrueVoxels = kOracleRows[1], *kTrueLatents = kOracleRows[2],
                     *kWhole = kOracleRows[3];

/// Columns of both tables, and those that registration changes.
constexpr const char* kColumns[] = {"j2j",     "j2b",     "b2b",    "wasserstein",     "gromov_wasserstein",
                                    "skin_l1", "skin_kl", "fscore", "surface_chamfer", "joint_count_error"};
const std::set<std::string> kMovedGroups = {"skeleton", "surface"};

fs::path oracle_mesh(const fs::path& output, const std::string& row, const std::string& id) {
  return output / row / id / "mesh.glb";
}

/// bool [R, R, R] of the places of one asset.
Tensor grid_of(const sparse::Support& support, std::int64_t resolution) {
  const Tensor places = support.coords().to(torch::kCPU, torch::kInt64);
  Tensor grid = torch::zeros({resolution, resolution, resolution}, torch::kBool);
  grid.index_put_({places.select(1, 1), places.select(1, 2), places.select(1, 3)}, torch::ones({}, torch::kBool));
  return grid;
}

/// The trained models at work on the assets of one dataset.
class OracleRun {
 public:
  explicit OracleRun(const OracleRequest& request)
      : request_(request.generation),
        dataset_(request.pairs.truth),
        generator_(request_.models),
        conditions_(request_, generator_),
        structure_(generator_.structure_coder()),
        latents_(generator_.latent_coder()) {}

  void require_usable(const NamedPicture& picture) const { latents_.require_features_anywhere(asset_of(picture)); }

  Json settings(const NamedPicture& picture) const {
    Json settings = generation_settings(request_, generator_.runs(), picture);
    Json& files = settings["asset"] = Json::array();
    std::vector<fs::path> read = latents_.files(asset_of(picture));
    read.push_back(data::surface_voxel_path(asset_of(picture)));
    std::error_code error;
    for (const fs::path& file : read)
      files.push_back(
          {file.string(), fs::file_size(file, error), fs::last_write_time(file, error).time_since_epoch().count()});
    return settings;
  }

  OracleAsset make(const NamedPicture& picture) {
    OracleAsset made;
    made.id = picture.name;
    const data::AssetId asset = asset_of(picture);
    std::error_code error;
    for (const char* row : kOracleRows) fs::remove(oracle_mesh(request_.output, row, made.id), error);

    std::optional<data::SparseStructureBatch> truth;
    std::optional<structured_latent::PerStream<sparse::SparseTensor>> encoded;
    std::optional<VoxelPair> sampled;
    Seen seen;
    std::string unseen;  // why there is no condition
    attempt(unseen, [&] { seen = see(picture); });
    attempt(made, kStageTwo, [&] {
      truth = structure_.voxels(asset);
      made.structure[kStageTwo] = structure_score(structure_.reconstruct(*truth), pair_of(*truth));
    });
    attempt(made, kAutoEncoder, [&] {
      encoded = latents_.encode(latents_.inputs(asset));
      write(kAutoEncoder, made.id, with_latents(*encoded), seen);
    });
    attempt(made, kTrueVoxels, [&] {
      if (!encoded) throw Error(made.failures.at(kAutoEncoder));
      if (!unseen.empty()) throw Error(unseen);
      write(kTrueVoxels, made.id,
            with_voxels({grid_of(*encoded->geometry.support, generator_.grid()),
                         grid_of(*encoded->skeleton.support, generator_.grid())}),
            seen);
    });
    attempt(made, kWhole, [&] {
      if (!unseen.empty()) throw Error(unseen);
      sampled = generator_.sample_voxels(seen.first, made.id, request_.sampling);
      if (truth) made.structure[kStageFour] = structure_score(*sampled, pair_of(*truth));
      write(kWhole, made.id, with_voxels(*sampled), seen);
    });
    attempt(made, kTrueLatents, [&] {
      if (!sampled || !sampled->shape.any().item<bool>() || !sampled->skeleton.any().item<bool>())
        throw Error(made.failures.at(kWhole));
      write(kTrueLatents, made.id, with_latents(latents_.encode(latents_.inputs_at(asset, *sampled))), seen);
    });
    for (const auto& [row, failure] : made.failures) log::warn("{}: {}: {}", made.id, row, failure);
    return made;
  }

 private:
  /// Tokens of the picture for the two flows; undefined for given latents.
  struct Seen {
    Tensor first, second;
  };

  data::AssetId asset_of(const NamedPicture& picture) const {
    data::AssetId asset;
    asset.root = dataset_;
    asset.id = picture.name;
    return asset;
  }

  static VoxelPair pair_of(const data::SparseStructureBatch& voxels) {
    return {voxels.ss[0][0] > 0, voxels.ss_skl[0][0] > 0};
  }

  static void attempt(std::string& failure, const std::function<void()>& work) {
    throw_if_interrupted();
    try {
      work();
    } catch (...) {
      failure = failure_of_item();
    }
  }
  static void attempt(OracleAsset& made, const char* row, const std::function<void()>& work) {
    std::string failure;
    attempt(failure, work);
    if (!failure.empty()) made.failures[row] = failure;
  }

  Seen see(const NamedPicture& picture) {
    const std::map<int, PreprocessedImage> by_size = conditions_.of(picture);
    const PreprocessedImage& first = by_size.at(generator_.structure_size());
    return {generator_.structure_sees_normals() ? first.normals_tensor : first.picture_tensor,
            by_size.at(generator_.latent_size()).picture_tensor};
  }

  GenerationOptions with_voxels(const VoxelPair& voxels) const {
    GenerationOptions options = request_.sampling;
    options.given_voxels = voxels;
    return options;
  }
  GenerationOptions with_latents(const structured_latent::PerStream<sparse::SparseTensor>& latents) const {
    GenerationOptions options = request_.sampling;
    options.given_latents = latents;
    return options;
  }

  void write(const char* row, const std::string& id, const GenerationOptions& options, const Seen& seen) {
    const GeneratedAsset made = generator_.generate(seen.first, seen.second, id, options);
    throw_if_interrupted();
    const FinishingOptions finishing = finishing_of_flow(request_.finishing, request_.models.latent_flow);
    io::write_gltf(oracle_mesh(request_.output, row, id), finish_asset(made.decoded.asset, finishing).asset);
  }

  const GenerateRequest& request_;
  fs::path dataset_;
  AssetGenerator generator_;
  ConditionPictures conditions_;
  StructureCoder structure_;
  StructuredLatentCoder latents_;
};

/// Results of single assets, from which a stopped run goes on.
class OracleRecords {
 public:
  explicit OracleRecords(const GenerateRequest& request) : request_(request) {}

  /// Nothing unless it was made so, by this build or an accepted one, and its meshes are there.
  std::optional<OracleAsset> kept(const std::string& id, const Json& settings) const {
    OracleAsset asset;
    try {
      const Json found = read_json(file(id));
      if (found.at("settings") != settings) return std::nullopt;
      if (!request_.accept_other_code && commit_of(found) != commit()) return std::nullopt;
      asset = found.at("result").get<OracleAsset>();
    } catch (const InputError&) {
      return std::nullopt;
    } catch (const Json::exception&) {
      return std::nullopt;
    }
    std::error_code error;
    for (const char* row : kOracleRows) {
      if (asset.failures.count(row) == 0 && !fs::is_regular_file(oracle_mesh(request_.output, row, id), error))
        return std::nullopt;
    }
    return asset;
  }

  void write(const OracleAsset& asset, const Json& settings) const {
    const Json record{{"made_by", made_by()}, {"settings", settings}, {"result", asset}};
    write_file_atomically(file(asset.id), record.dump(2) + "\n");
  }

 private:
  fs::path file(const std::string& id) const { return request_.output / "assets" / (id + ".json"); }

  const GenerateRequest& request_;
};

void refuse_lossy_oracle(const OracleRequest& request, const std::vector<NamedPicture>& pictures) {
  const fs::path& output = request.generation.output;
  std::vector<fs::path> outputs{output / "oracle.md", output / "oracle.json"};
  for (const NamedPicture& picture : pictures) {
    outputs.push_back(output / "assets" / (picture.name + ".json"));
    for (const char* row : kOracleRows) outputs.push_back(oracle_mesh(output, row, picture.name));
  }
  refuse_to_overwrite(outputs, [&] {
    std::vector<fs::path> inputs = request.pairs.splits;
    for (const NamedPicture& picture : pictures) {
      inputs.push_back(picture.file);
      inputs.push_back(request.pairs.truth / "assets" / (picture.name + ".glb"));
    }
    return inputs;
  });
}

std::vector<OracleAsset> make_assets(const OracleRequest& request, const std::vector<NamedPicture>& pictures) {
  OracleRun run(request);
  for (const NamedPicture& picture : pictures) run.require_usable(picture);
  const OracleRecords records(request.generation);
  std::vector<std::string> names;
  for (const NamedPicture& picture : pictures) names.push_back(picture.name);
  std::vector<std::optional<OracleAsset>> made(pictures.size());
  const LeaseFolder leases(request.generation.output / ".leases");
  work_in_turn(
      leases, names,
      [&](std::size_t i) {
        if (made[i]) return true;
        if (!request.generation.again) made[i] = records.kept(names[i], run.settings(pictures[i]));
        return made[i].has_value();
      },
      [&](std::size_t i) {
        log::info("asset {} of {}: {}", i + 1, pictures.size(), names[i]);
        const Json settings = run.settings(pictures[i]);
        made[i] = run.make(pictures[i]);
        records.write(*made[i], settings);
      });
  leases.remove_left();
  std::vector<OracleAsset> assets;
  for (std::optional<OracleAsset>& asset : made) assets.push_back(std::move(*asset));
  return assets;
}

/// All rows that have a mesh. @param part folder of the results
std::optional<eval::Comparison> compare(const OracleRequest& request, const std::vector<OracleAsset>& assets,
                                        const char* part, bool registered) {
  eval::EvaluationRequest pairs = request.pairs;
  pairs.predictions.clear();
  for (const char* row : kOracleRows) {
    const bool any = std::any_of(assets.begin(), assets.end(),
                                 [&](const OracleAsset& asset) { return asset.failures.count(row) == 0; });
    if (any) pairs.predictions.push_back(std::string(row) + "=" + (request.generation.output / row).string());
  }
  if (pairs.predictions.empty()) return std::nullopt;
  pairs.out = request.generation.output / part;
  pairs.settings.alignment.icp = registered;
  if (!registered && request.pairs.settings.alignment.icp) {
    std::set<std::string> moved;
    for (const std::string& group : kMovedGroups)
      if (pairs.settings.wants(group)) moved.insert(group);
    if (moved.empty()) return std::nullopt;
    pairs.settings.groups = moved;
  }
  return eval::run_evaluation(pairs);
}

std::vector<const eval::MetricInfo*> columns_of(const eval::Comparison& comparison) {
  std::vector<const eval::MetricInfo*> columns;
  for (const eval::MetricInfo* metric : eval::present_metrics(comparison, /*headline=*/false)) {
    if (std::find(std::begin(kColumns), std::end(kColumns), metric->key) != std::end(kColumns))
      columns.push_back(metric);
  }
  return columns;
}

/// Mean over the assets that have it, and how many do.
std::pair<StructureScore, std::size_t> mean_score(const std::vector<OracleAsset>& assets, const char* stage) {
  StructureEvaluation all;
  all.scores.emplace_back();
  for (const OracleAsset& asset : assets) {
    const auto found = asset.structure.find(stage);
    if (found == asset.structure.end()) continue;
    all.ids.push_back(asset.id);
    all.scores.front().push_back(found->second);
  }
  return {all.mean(0), all.ids.size()};
}

Json means_of(const std::optional<eval::Comparison>& comparison, const std::string& row) {
  Json means = Json::object();
  if (!comparison) return means;
  const auto& methods = comparison->methods;
  const auto found = std::find(methods.begin(), methods.end(), row);
  if (found == methods.end()) return means;
  for (const eval::MetricInfo* metric : columns_of(*comparison)) {
    const eval::Summary summary =
        eval::summarize_metric(*comparison, static_cast<std::size_t>(found - methods.begin()), metric->key).summary;
    if (summary.n > 0) means[metric->key] = {{"mean", summary.mean}, {"n", summary.n}};
  }
  return means;
}

}  // namespace

Oracle evaluate_oracle(const OracleRequest& request) {
  request.generation.finishing.validate();
  eval::check(request.pairs.settings);
  const std::vector<NamedPicture> pictures =
      pictures_of_dataset(request.pairs.truth, request.pairs.splits, request.pairs.most);
  refuse_lossy_oracle(request, pictures);
  const torch::NoGradGuard no_grad;
  Oracle oracle;
  oracle.assets = make_assets(request, pictures);
  if (request.pairs.settings.alignment.icp) oracle.aligned = compare(request, oracle.assets, "aligned", true);
  oracle.unaligned = compare(request, oracle.assets, "unaligned", false);
  oracle.settings = {{"made_by", made_by()},
                     {"dataset", request.pairs.truth.string()},
                     {"splits", request.pairs.splits},
                     {"ss_flow", request.generation.models.structure_flow.string()},
                     {"slat_flow", request.generation.models.latent_flow.string()},
                     {"seed", request.generation.sampling.seed},
                     {"pairs", to_json(request.pairs.settings)}};
  write_file_atomically(request.generation.output / "oracle.json", to_json(oracle).dump(2) + "\n");
  write_file_atomically(request.generation.output / "oracle.md", to_markdown(oracle));
  return oracle;
}

std::size_t failures(const Oracle& oracle) {
  return static_cast<std::size_t>(std::count_if(oracle.assets.begin(), oracle.assets.end(),
                                                [](const OracleAsset& asset) { return !asset.failures.empty(); }));
}

Json to_json(const Oracle& oracle) {
  Json rows = Json::object(), voxels = Json::object();
  for (const char* row : kOracleRows)
    rows[row] = {{"aligned", means_of(oracle.aligned, row)}, {"unaligned", means_of(oracle.unaligned, row)}};
  for (const char* stage : {kStageTwo, kStageFour}) {
    const auto [score, count] = mean_score(oracle.assets, stage);
    if (count > 0) voxels[stage] = {{"mean", score}, {"n", count}};
  }
  return {{"settings", oracle.settings}, {"rows", rows}, {"voxels", voxels}, {"assets", oracle.assets}};
}

std::string to_markdown(const Oracle& oracle) {
  std::string text =
      "# Where the error enters\n\n"
      "autoencoder: true voxels and latents; true_voxels: stage 5 on true voxels; true_latents: true latents on the "
      "voxels of stage 4; generation: both sampled.\n";
  const auto add = [&](const char* title, const std::optional<eval::Comparison>& comparison) {
    if (!comparison) return;
    text +=
        std::string("\n## ") + title + "\n\n" + to_markdown(eval::method_table(*comparison, columns_of(*comparison)));
  };
  add("Rigs, registered", oracle.aligned);
  add("Rigs, not registered", oracle.unaligned);
  Table voxels{{"voxels", "assets", "IoU", "F1", "IoU skeleton", "F1 skeleton", "skeleton inside"}, {}};
  for (const char* stage : {kStageTwo, kStageFour}) {
    const auto [score, count] = mean_score(oracle.assets, stage);
    if (count == 0) continue;
    voxels.rows.push_back({stage, std::to_string(count)});
    for (const double value : {score.iou, score.f1, score.iou_skl, score.f1_skl, score.inside})
      voxels.rows.back().push_back(fixed(value, 3));
  }
  text += "\n## Voxels against the dataset's\n\n" + to_markdown(voxels);
  Table failed{{"row", "asset", "failure"}, {}};
  for (const OracleAsset& asset : oracle.assets) {
    for (const auto& [row, failure] : asset.failures) failed.rows.push_back({row, asset.id, failure});
  }
  if (!failed.rows.empty()) text += "\n## Failures\n\n" + to_markdown(failed);
  return text;
}

}  // namespace anigen::generate
