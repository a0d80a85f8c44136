#include "anigen/pipeline/structure_evaluation.h"

#include <algorithm>
#include <limits>
#include <map>
#include <memory>
#include <utility>

#include "anigen/core/atomic_file.h"
#include "anigen/core/csv.h"
#include "anigen/core/error.h"
#include "anigen/core/interrupt.h"
#include "anigen/core/log.h"
#include "anigen/core/progress.h"
#include "anigen/core/short_id.h"
#include "anigen/models/voxel_inside.h"
#include "anigen/models/voxel_sheet.h"
#include "anigen/pipeline/device.h"
#include "anigen/pipeline/structure_coder.h"
#include "anigen/pipeline/structure_retrieval.h"

namespace anigen::pipeline {
namespace {

namespace fs = std::filesystem;
using torch::Tensor;

constexpr std::int64_t kSampledAtOnce = 4;  // assets; the answer does not depend on it beyond rounding

/// @param held_out assets to evaluate: a share of the training assets does not reduce them
std::unique_ptr<loaders::StructureLatentDataset> dataset_of(const loaders::StructureLatentOptions& reading,
                                                            const std::string& data, const fs::path& split,
                                                            std::uint64_t seed, bool held_out) {
  loaders::StructureLatentOptions options = reading;
  if (!data.empty()) options.sources.data_dir = data;
  if (!split.empty()) options.sources.split = split.string();
  options.sources.eval_split.clear();
  options.sources.eval_fraction = 0.0;
  if (held_out) options.sources.train_share = 1.0;
  options.sources.filter.repeat.clear();
  return std::make_unique<loaders::StructureLatentDataset>(loaders::select(options.sources).train, options, seed);
}

std::map<std::string, std::string> sources_of(const std::string& roots) {
  std::map<std::string, std::string> sources;
  for (std::size_t begin = 0; begin <= roots.size();) {
    const std::size_t end = std::min(roots.find(',', begin), roots.size());
    const CsvTable table = read_csv(fs::path(roots.substr(begin, end - begin)) / "metadata.csv");
    for (std::size_t row = 0; row < table.rows.size(); ++row) {
      sources[table.cell(row, "sha256")] = table.cell(row, "source");
    }
    begin = end + 1;
  }
  return sources;
}

StructureScore score(const models::VoxelPair& made, const models::VoxelPair& truth) {
  const models::VoxelAgreement shape = models::voxel_agreement(made.shape, truth.shape);
  const models::VoxelAgreement skeleton = models::voxel_agreement(made.skeleton, truth.skeleton);
  return {shape.iou, shape.f1, skeleton.iou, skeleton.f1, models::share_inside(made.skeleton, made.shape)};
}

/// One run of the comparison.
class StructureComparison {
 public:
  explicit StructureComparison(const StructureEvaluationRequest& request)
      : request_(request),
        generator_({request.run, request.autoencoder, "", request.device}),
        coder_(generator_.autoencoder(), generator_.reading().ss_dec_ckpt, parse_device(request.device), false),
        assets_(dataset_of(generator_.reading(), request.data, request.split, request.seed, true)) {
    sampler_ = generator_.sampler();
    if (request.steps > 0) sampler_.steps = request.steps;
    strengths_ = request.strengths.empty() ? std::vector<double>{sampler_.cfg_strength} : request.strengths;
    if (request.retrieval_views > 0) {
      training_ = dataset_of(generator_.reading(), request.data, request.train_split, request.seed, false);
      retrieval_ = std::make_unique<StructureRetrieval>(generator_, *training_, request.retrieval_views);
    }
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
    for (const double strength : strengths_) result_.methods.push_back("flow, guidance " + eval::fixed(strength, 1));
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
                        {"split", request_.split.string()},
                        {"steps", sampler_.steps},
                        {"seed", request_.seed},
                        {"retrieval_views", request_.retrieval_views}};
  }

  models::VoxelPair truth_of(const loaders::AssetId& asset) const {
    const loaders::SparseStructureBatch voxels = coder_.voxels(asset);
    return {voxels.ss[0][0] > 0, voxels.ss_skl[0][0] > 0};
  }

  void compare(std::size_t begin, std::size_t end) {
    std::vector<loaders::Draw> draws;
    std::vector<Tensor> noise, noise_skl;
    for (std::size_t i = begin; i < end; ++i) {
      draws.push_back({i, i});
      const flow::Streams one = generator_.noise(request_.seed, i);
      noise.push_back(one[0]);
      noise_skl.push_back(one[1]);
    }
    const auto batch = assets_->load(draws);
    const auto& latents = dynamic_cast<const loaders::StructureLatentBatch&>(*batch);
    const Tensor condition = generator_.condition(latents.cond);
    const flow::Streams start{torch::cat(noise), torch::cat(noise_skl)};

    std::vector<std::vector<models::VoxelPair>> made;  // [method][asset of the batch]
    made.push_back(generator_.decode(generator_.sample(start, condition, sampler_, false)));
    for (const double strength : strengths_) {
      flow::SamplerOptions guided = sampler_;
      guided.cfg_strength = strength;
      made.push_back(generator_.decode(generator_.sample(start, condition, guided, true)));
    }
    made.push_back(generator_.decode({latents.x_0, latents.x_0_skl}));
    const auto rows = static_cast<std::int64_t>(end - begin);
    if (retrieval_) {
      std::vector<models::VoxelPair> by_color, by_tokens;
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
      const models::VoxelPair truth = truth_of(assets_->asset(begin + at));
      for (std::size_t m = 0; m < made.size(); ++m) result_.scores[m].push_back(score(made[m][at], truth));
      result_.scores.back().push_back(score(truth, truth));
      if (sheet_.size() < request_.pictured) picture(latents, i, made, truth);
    }
  }

  void picture(const loaders::StructureLatentBatch& latents, std::int64_t item,
               const std::vector<std::vector<models::VoxelPair>>& made, const models::VoxelPair& truth) {
    models::VoxelSheetRow row;
    row.label = short_id(latents.ids[static_cast<std::size_t>(item)]);
    row.picture = models::picture_of_planes(latents.cond[item]);
    for (const auto& method : made) row.cells.push_back(method[static_cast<std::size_t>(item)]);
    row.cells.push_back(truth);
    sheet_.push_back(std::move(row));
  }

  void write() const {
    CsvTable rows{{"id", "source", "method", "iou", "f1", "iou_skl", "f1_skl", "inside"}, {}};
    for (std::size_t m = 0; m < result_.methods.size(); ++m) {
      for (std::size_t i = 0; i < result_.ids.size(); ++i) {
        const StructureScore& s = result_.scores[m][i];
        rows.rows.push_back({result_.ids[i], result_.sources[i], result_.methods[m], eval::fixed(s.iou, 6),
                             eval::fixed(s.f1, 6), eval::fixed(s.iou_skl, 6), eval::fixed(s.f1_skl, 6),
                             eval::fixed(s.inside, 6)});
      }
    }
    write_file_atomically(request_.out / "metrics.csv", to_csv(rows));
    Json means = Json::object();
    for (std::size_t m = 0; m < result_.methods.size(); ++m) {
      const StructureScore s = result_.mean(m);
      means[result_.methods[m]] = {
          {"iou", s.iou}, {"f1", s.f1}, {"iou_skl", s.iou_skl}, {"f1_skl", s.f1_skl}, {"inside", s.inside}};
    }
    const Json all{{"settings", result_.settings}, {"assets", result_.ids.size()}, {"means", means}};
    write_file_atomically(request_.out / "metrics.json", all.dump(2) + "\n");
    write_file_atomically(request_.out / "table.md", eval::to_markdown(result_.table()) + "\n");
    std::vector<std::string> columns = result_.methods;
    models::write_voxel_sheet(request_.out / "samples.png", sheet_, columns);
  }

  StructureEvaluationRequest request_;
  StructureGenerator generator_;
  StructureCoder coder_;
  std::unique_ptr<loaders::StructureLatentDataset> assets_;
  flow::SamplerOptions sampler_;
  std::vector<double> strengths_;
  std::unique_ptr<loaders::StructureLatentDataset> training_;
  std::unique_ptr<StructureRetrieval> retrieval_;
  std::vector<models::VoxelSheetRow> sheet_;
  StructureEvaluation result_;
};

}  // namespace

StructureScore StructureEvaluation::mean(std::size_t method, const std::string& source) const {
  StructureScore sum;
  std::size_t count = 0;
  for (std::size_t i = 0; i < ids.size(); ++i) {
    if (sources[i].compare(0, source.size(), source) != 0) continue;
    const StructureScore& s = scores[method][i];
    sum.iou += s.iou;
    sum.f1 += s.f1;
    sum.iou_skl += s.iou_skl;
    sum.f1_skl += s.f1_skl;
    sum.inside += s.inside;
    ++count;
  }
  const double n = count == 0 ? std::numeric_limits<double>::quiet_NaN() : static_cast<double>(count);
  return {sum.iou / n, sum.f1 / n, sum.iou_skl / n, sum.f1_skl / n, sum.inside / n};
}

eval::Table StructureEvaluation::table(const std::string& source) const {
  eval::Table table{{"method", "IoU", "F1", "IoU skeleton", "F1 skeleton", "skeleton inside"}, {}};
  for (std::size_t m = 0; m < methods.size(); ++m) {
    const StructureScore s = mean(m, source);
    table.rows.push_back({methods[m], eval::fixed(s.iou, 3), eval::fixed(s.f1, 3), eval::fixed(s.iou_skl, 3),
                          eval::fixed(s.f1_skl, 3), eval::fixed(s.inside, 3)});
  }
  return table;
}

StructureEvaluation evaluate_structures(const StructureEvaluationRequest& request) {
  if (request.split.empty()) throw InputError("", "--split", "which assets? A file of ids, such as splits/test.txt");
  refuse_to_overwrite({request.out / "metrics.csv", request.out / "metrics.json", request.out / "table.md",
                       request.out / "samples.png"},
                      [&] {
                        return std::vector<std::filesystem::path>{request.split, request.train_split,
                                                                  request.run / "metrics.csv",
                                                                  request.autoencoder / "metrics.csv"};
                      });
  const torch::NoGradGuard no_grad;
  return StructureComparison(request).run();
}

}  // namespace anigen::pipeline
