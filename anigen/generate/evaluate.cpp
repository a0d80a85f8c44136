#include "anigen/generate/evaluate.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <memory>
#include <set>
#include <sstream>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/hash.h"
#include "anigen/core/log.h"
#include "anigen/core/numeric.h"
#include "anigen/core/process.h"
#include "anigen/core/run_folder.h"
#include "anigen/generate/retrieve.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/io/arrays/torch_archive.h"
#include "anigen/nn/profile.h"
#include "anigen/sparse_structure/voxel_metrics.h"
#include "anigen/sparse_structure/voxel_picture.h"

namespace anigen::generate {

namespace {

using torch::Tensor;

// Descriptions of pictures, in which near means alike: one row each.
struct PictureFeatures {
  Tensor color;   // [N, 3 · cells²], picture_cells()
  Tensor tokens;  // [N, M · C] the image encoder's tokens, of length 1
};

// Of pictures [B, 3, S, S].
PictureFeatures picture_features(StructureGenerator& generator, const Tensor& pictures) {
  const torch::NoGradGuard no_grad;
  const Tensor tokens = generator.condition(pictures).to(torch::kCPU).flatten(1);
  return {picture_cells(pictures), tokens / tokens.norm(2, {1}, /*keepdim=*/true).clamp_min(1e-12)};
}

// The training pictures that new ones are compared with.
class StructureRetrieval {
 public:
  // Takes `views` random condition views of every training asset.
  StructureRetrieval(StructureGenerator& generator, const data::StructureLatentDataset& training, std::size_t views)
      : views_(views) {
    std::vector<Tensor> color, tokens;
    Progress progress("describing training pictures", training.assets(), "assets");
    for (std::size_t asset = 0; asset < training.assets(); ++asset) {
      throw_if_interrupted();
      std::vector<data::Draw> draws;
      for (std::size_t view = 0; view < views; ++view) {
        draws.push_back({training.item_of(asset), asset * views + view});  // the position chooses the view
      }
      const auto batch = training.load(draws);
      const PictureFeatures one =
          picture_features(generator, dynamic_cast<const data::StructureLatentBatch&>(*batch).cond);
      color.push_back(one.color);
      tokens.push_back(one.tokens);
      progress.advance();
    }
    progress.finish();
    features_ = {torch::cat(color), torch::cat(tokens)};
  }

  struct Nearest {
    std::size_t by_color = 0, by_tokens = 0;  // training assets
  };
  // The training assets nearest to one picture.
  Nearest nearest(const PictureFeatures& features) const {
    const auto row = [&](const Tensor& distances) {
      return static_cast<std::size_t>(distances.argmin().item<std::int64_t>()) / views_;
    };
    return {row((features_.color - features.color).square().sum(1)), row(-features_.tokens.mv(features.tokens[0]))};
  }

 private:
  PictureFeatures features_;
  std::size_t views_;
};

namespace fs = std::filesystem;

constexpr std::int64_t kSampledAtOnce = 4;  // assets; the answer does not depend on it beyond rounding

/// @param splits files of ids; empty: the assets that the run was trained on
/// @param evaluated assets to evaluate, which a gallery of training assets leaves out unless `splits` name them; null
/// when these are what is opened: a share of the training assets does not reduce them
std::unique_ptr<data::StructureLatentDataset> dataset_of(const data::StructureLatentOptions& reading,
                                                         const std::string& data, const std::vector<fs::path>& splits,
                                                         std::uint64_t seed,
                                                         const data::StructureLatentDataset* evaluated) {
  data::StructureLatentOptions options = reading;
  if (!data.empty()) options.sources.data_dir = data;
  if (!splits.empty()) {
    options.sources.split.clear();
    std::set<std::string>& ids = options.sources.filter.only.emplace();
    const std::string& roots = options.sources.data_dir;
    for (const fs::path& split : splits)
      ids.merge(data::read_split(data::file_of_dataset(split.string(), roots), roots));
  }
  if (evaluated == nullptr || !splits.empty()) {
    options.sources.eval_split.clear();
    options.sources.eval_fraction = 0.0;
  }
  if (evaluated == nullptr) options.sources.train_share = 1.0;
  options.sources.filter.repeat.clear();
  std::vector<data::AssetId> assets = data::select(options.sources).train;
  if (evaluated != nullptr && splits.empty()) {
    std::set<std::string> ids;
    for (std::size_t i = 0; i < evaluated->assets(); ++i) ids.insert(evaluated->asset(i).id);
    const auto is_evaluated = [&](const data::AssetId& asset) { return ids.count(asset.id) > 0; };
    assets.erase(std::remove_if(assets.begin(), assets.end(), is_evaluated), assets.end());
    if (assets.empty())
      throw InputError("--train-split", "",
                       "retrieval has no training asset that is not evaluated: name others, or --retrieval-views 0");
  }
  return std::make_unique<data::StructureLatentDataset>(std::move(assets), options, seed);
}

std::map<std::string, std::string> sources_of(const std::string& roots) {
  std::map<std::string, std::string> sources;
  std::istringstream names(roots);
  for (std::string root; std::getline(names, root, ',');) {
    const CsvTable table = read_csv(fs::path(root) / "metadata.csv");
    for (std::size_t row = 0; row < table.rows.size(); ++row)
      sources[table.cell(row, "sha256")] = table.cell(row, "source");
  }
  return sources;
}

/// In the order of all tables.
constexpr double StructureScore::*kValues[] = {&StructureScore::iou, &StructureScore::f1, &StructureScore::iou_skl,
                                               &StructureScore::f1_skl, &StructureScore::inside};

StructureGenerator::Request generator_of(const StructureEvaluationRequest& request) {
  StructureGenerator::Request generator;
  generator.run = request.run;
  generator.device = request.device;
  generator.autoencoder = request.autoencoder;
  return generator;
}

/// One run of the comparison.
class StructureComparison {
 public:
  explicit StructureComparison(const StructureEvaluationRequest& request)
      : request_(request),
        generator_(generator_of(request)),
        coder_(generator_.autoencoder(), generator_.reading().ss_dec_ckpt, nn::parse_device(request.device), false),
        assets_(dataset_of(generator_.reading(), request.data, request.splits, request.seed, nullptr)) {
    sampler_ = generator_.sampler();
    if (request.steps > 0) sampler_.steps = request.steps;
    strengths_ = request.strengths.empty() ? std::vector<double>{sampler_.cfg_strength} : request.strengths;
    if (request.retrieval_views > 0) {
      std::vector<fs::path> train_splits;
      if (!request.train_split.empty()) train_splits.push_back(request.train_split);
      training_ = dataset_of(generator_.reading(), request.data, train_splits, request.seed, assets_.get());
      retrieval_ = std::make_unique<StructureRetrieval>(generator_, *training_, request.retrieval_views);
    }
    // A strength of 0 is the row that is not guided.
    strengths_.erase(std::remove(strengths_.begin(), strengths_.end(), 0.0), strengths_.end());
    name_methods();
  }

  StructureEvaluation run() {
    const std::map<std::string, std::string> sources = sources_of(assets_->options().sources.data_dir);
    const std::size_t count = request_.most == 0 ? assets_->assets() : std::min(request_.most, assets_->assets());
    Progress progress("generating", count, "assets");
    for (std::size_t begin = 0; begin < count; begin += static_cast<std::size_t>(kSampledAtOnce)) {
      throw_if_interrupted();
      const std::size_t end = std::min(count, begin + static_cast<std::size_t>(kSampledAtOnce));
      compare(begin, end);
      for (std::size_t i = begin; i < end; ++i) {
        result_.ids.push_back(assets_->asset(i).id);
        const auto found = sources.find(assets_->asset(i).id);
        result_.sources.push_back(found == sources.end() ? "" : found->second);
        progress.advance();
      }
    }
    progress.finish();
    write();
    return std::move(result_);
  }

 private:
  void name_methods() {
    result_.methods = {"flow, not guided"};
    for (const double strength : strengths_) result_.methods.push_back("flow, guidance " + fixed(strength, 1));
    result_.methods.emplace_back("auto-encoder");
    if (retrieval_) {
      result_.methods.emplace_back("retrieval by colour");
      result_.methods.emplace_back("retrieval by tokens");
    }
    result_.methods.emplace_back("ground truth");
    result_.scores.resize(result_.methods.size());
    result_.settings = {{"run", request_.run.string()},
                        {"checkpoint", generator_.flow().checkpoint.string()},
                        {"autoencoder", coder_.checkpoint().string()},
                        {"splits", request_.splits},
                        {"steps", sampler_.steps},
                        {"seed", request_.seed},
                        {"retrieval_views", request_.retrieval_views}};
  }

  sparse_structure::VoxelPair truth_of(const data::AssetId& asset) const {
    const data::SparseStructureBatch voxels = coder_.voxels(asset);
    return {voxels.ss[0][0] > 0, voxels.ss_skl[0][0] > 0};
  }

  void compare(std::size_t begin, std::size_t end) {
    std::vector<data::Draw> draws;
    std::vector<Tensor> noise, noise_skl;
    for (std::size_t i = begin; i < end; ++i) {
      draws.push_back({i, i});
      const flow::Streams one = generator_.noise(request_.seed, i);
      noise.push_back(one[0]);
      noise_skl.push_back(one[1]);
    }
    const auto batch = assets_->load(draws);
    const auto& latents = dynamic_cast<const data::StructureLatentBatch&>(*batch);
    const Tensor condition = generator_.condition(latents.cond);
    const flow::Streams start{torch::cat(noise), torch::cat(noise_skl)};

    std::vector<std::vector<sparse_structure::VoxelPair>> made;  // [method][asset of the batch]
    made.push_back(generator_.decode(generator_.sample(start, condition, sampler_, false)));
    for (const double strength : strengths_) {
      flow::SamplerOptions guided = sampler_;
      guided.cfg_strength = strength;
      made.push_back(generator_.decode(generator_.sample(start, condition, guided, true)));
    }
    made.push_back(generator_.decode({latents.x_0, latents.x_0_skl}));
    const auto rows = static_cast<std::int64_t>(end - begin);
    if (retrieval_) {
      std::vector<sparse_structure::VoxelPair> by_color, by_tokens;
      for (std::int64_t i = 0; i < rows; ++i) {
        const auto nearest = retrieval_->nearest(picture_features(generator_, latents.cond.narrow(0, i, 1)));
        by_color.push_back(truth_of(training_->asset(nearest.by_color)));
        by_tokens.push_back(truth_of(training_->asset(nearest.by_tokens)));
      }
      made.push_back(std::move(by_color));
      made.push_back(std::move(by_tokens));
    }
    for (std::int64_t i = 0; i < rows; ++i) {
      const auto at = static_cast<std::size_t>(i);
      const sparse_structure::VoxelPair truth = truth_of(assets_->asset(begin + at));
      for (std::size_t m = 0; m < made.size(); ++m) result_.scores[m].push_back(structure_score(made[m][at], truth));
      result_.scores.back().push_back(structure_score(truth, truth));
      if (sheet_.size() < request_.pictured) picture(latents, i, made, truth);
    }
  }

  void picture(const data::StructureLatentBatch& latents, std::int64_t item,
               const std::vector<std::vector<sparse_structure::VoxelPair>>& made,
               const sparse_structure::VoxelPair& truth) {
    sparse_structure::VoxelSheetRow row;
    row.label = short_id(latents.ids[static_cast<std::size_t>(item)]);
    row.picture = sparse_structure::picture_of_planes(latents.cond[item]);
    for (const auto& method : made) row.cells.push_back(method[static_cast<std::size_t>(item)]);
    row.cells.push_back(truth);
    sheet_.push_back(std::move(row));
  }

  void write() const {
    CsvTable rows{{"id", "source", "method", "iou", "f1", "iou_skl", "f1_skl", "inside"}, {}};
    for (std::size_t m = 0; m < result_.methods.size(); ++m) {
      for (std::size_t i = 0; i < result_.ids.size(); ++i) {
        rows.rows.push_back({result_.ids[i], result_.sources[i], result_.methods[m]});
        for (const auto value : kValues) rows.rows.back().push_back(fixed(result_.scores[m][i].*value, 6));
      }
    }
    write_file_atomically(request_.out / "metrics.csv", to_csv(rows));
    Json means = Json::object();
    for (std::size_t m = 0; m < result_.methods.size(); ++m) means[result_.methods[m]] = result_.mean(m);
    const Json all{{"settings", result_.settings}, {"assets", result_.ids.size()}, {"means", means}};
    write_file_atomically(request_.out / "metrics.json", all.dump(2) + "\n");
    write_file_atomically(request_.out / "table.md", to_markdown(result_.table()) + "\n");
    if (!sheet_.empty()) sparse_structure::write_voxel_sheet(request_.out / "samples.png", sheet_, result_.methods);
  }

  StructureEvaluationRequest request_;
  StructureGenerator generator_;
  StructureCoder coder_;
  std::unique_ptr<data::StructureLatentDataset> assets_;
  flow::SamplerOptions sampler_;
  std::vector<double> strengths_;
  std::unique_ptr<data::StructureLatentDataset> training_;
  std::unique_ptr<StructureRetrieval> retrieval_;
  std::vector<sparse_structure::VoxelSheetRow> sheet_;
  StructureEvaluation result_;
};

constexpr std::int64_t kVerticesAtOnce = 8192;

/// Of a run folder, or of the one around a file of weights.
fs::path config_of(const fs::path& run) {
  std::error_code ignored;
  if (fs::is_directory(run, ignored)) return RunFolder{run}.config();
  return RunFolder::around(run).value_or(RunFolder{fs::absolute(run).parent_path().parent_path()}).config();
}

skin_field::SkinAutoEncoderOptions options_of(const fs::path& file) {
  const Json config = read_json(file);
  if (config.is_object() && config.contains("models") && config["models"].is_object()) {
    for (const auto& [key, model] : config["models"].items()) {
      if (!model.is_object() || !model.contains("name") || model["name"] != "SkinAutoEncoder") continue;
      return skin_field::SkinAutoEncoderOptions::from_json(model.contains("args") ? model["args"] : Json::object(),
                                                           file.string(), "/models/" + key + "/args");
    }
  }
  throw InputError(file.string(), "/models", "describes no model named SkinAutoEncoder");
}

}  // namespace

StructureScore structure_score(const sparse_structure::VoxelPair& made, const sparse_structure::VoxelPair& truth) {
  const sparse_structure::VoxelAgreement shape = sparse_structure::voxel_agreement(made.shape, truth.shape);
  const sparse_structure::VoxelAgreement skeleton = sparse_structure::voxel_agreement(made.skeleton, truth.skeleton);
  return {shape.iou, shape.f1, skeleton.iou, skeleton.f1, sparse_structure::share_inside(made.skeleton, made.shape)};
}

StructureScore StructureEvaluation::mean(std::size_t method) const {
  StructureScore sum;
  for (std::size_t i = 0; i < ids.size(); ++i) {
    for (const auto value : kValues) sum.*value += scores[method][i].*value;
  }
  const double n = ids.empty() ? std::numeric_limits<double>::quiet_NaN() : static_cast<double>(ids.size());
  for (const auto value : kValues) sum.*value /= n;
  return sum;
}

Table StructureEvaluation::table() const {
  Table table{{"method", "IoU", "F1", "IoU skeleton", "F1 skeleton", "skeleton inside"}, {}};
  for (std::size_t m = 0; m < methods.size(); ++m) {
    const StructureScore score = mean(m);
    table.rows.push_back({methods[m]});
    for (const auto value : kValues) table.rows.back().push_back(fixed(score.*value, 3));
  }
  return table;
}

StructureEvaluation evaluate_structures(const StructureEvaluationRequest& request) {
  if (request.splits.empty()) throw InputError("", "--split", "which assets? A file of ids, such as splits/test.txt");
  refuse_to_overwrite({request.out / "metrics.csv", request.out / "metrics.json", request.out / "table.md",
                       request.out / "samples.png"},
                      [&] {
                        std::vector<fs::path> inputs = request.splits;
                        inputs.insert(inputs.end(), {request.train_split, RunFolder{request.run}.metrics(),
                                                     RunFolder{request.autoencoder}.metrics()});
                        return inputs;
                      });
  const torch::NoGradGuard no_grad;
  return StructureComparison(request).run();
}

SkinReconstruction::SkinReconstruction(const fs::path& run, const std::string& device)
    : device_(nn::parse_device(device)) {
  std::error_code ignored;
  if (!fs::exists(run, ignored)) throw InputError(run.string(), "", "no such run folder or checkpoint");
  checkpoint_ = fs::is_directory(run, ignored) ? io::choose_flow_checkpoint(run, true) : run;
  model_ = skin_field::SkinAutoEncoder(options_of(config_of(run)), nn::Init::kNone);
  nn::load_state_dict(*model_, io::read_state_dict(checkpoint_), nn::LoadMode::kStrict, checkpoint_.string());
  model_->to(device_);
  model_->eval();
}

std::size_t SkinReconstruction::parameters() const {
  std::size_t count = 0;
  for (const auto& parameter : model_->parameters()) count += static_cast<std::size_t>(parameter.numel());
  return count;
}

std::vector<float> SkinReconstruction::reconstruct(const std::vector<Eigen::Vector3f>& joints,
                                                   const std::vector<int>& parents, const std::vector<float>& skin) {
  const torch::NoGradGuard no_grad;
  const auto joint_count = static_cast<std::int64_t>(joints.size());
  torch::Tensor positions = torch::empty({joint_count, 3}, torch::kFloat32);
  torch::Tensor parent_indices = torch::empty({joint_count}, torch::kInt64);
  for (std::int64_t j = 0; j < joint_count; ++j) {
    for (int k = 0; k < 3; ++k) positions.data_ptr<float>()[3 * j + k] = joints[static_cast<std::size_t>(j)][k];
    parent_indices.data_ptr<std::int64_t>()[j] = parents[static_cast<std::size_t>(j)];
  }
  const auto skeletons = skin_field::SkeletonBatch::from_lists({positions}, {parent_indices}).to(device_);
  const auto code = model_->encode_joints(skeletons);

  std::vector<float> result(skin.size());
  const std::int64_t vertices = joint_count > 0 ? static_cast<std::int64_t>(skin.size()) / joint_count : 0;
  for (std::int64_t first = 0; first < vertices; first += kVerticesAtOnce) {
    const std::int64_t rows = std::min(kVerticesAtOnce, vertices - first);
    const torch::Tensor truth =
        torch::from_blob(const_cast<float*>(skin.data()) + first * joint_count, {rows, joint_count}, torch::kFloat32)
            .to(device_);
    const torch::Tensor features = model_->encode_vertices(code, skeletons, {truth});
    const torch::Tensor decoded = model_->decode(features, skin_field::rows_of({truth}), code.features, skeletons)[0]
                                      .to(torch::kCPU)
                                      .contiguous();
    std::copy_n(decoded.data_ptr<float>(), rows * joint_count, result.data() + first * joint_count);
  }
  return result;
}

}  // namespace anigen::generate
