#include "anigen/generate/evaluate_matting.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/numeric.h"
#include "anigen/core/process.h"
#include "anigen/data/backgrounds.h"
#include "anigen/data/matting_dataset.h"
#include "anigen/generate/grabcut.h"
#include "anigen/generate/matting_network.h"
#include "anigen/generate/trained_matting.h"
#include "anigen/render/contact_sheet.h"
#include "anigen/sparse_structure/voxel_picture.h"

namespace anigen::generate {

namespace {

namespace fs = std::filesystem;

constexpr int kMattedSide = 256;  // pixels of the pictures

std::unique_ptr<data::MattingDataset> composed_pictures(const MattingEvaluationRequest& request) {
  data::MattingOptions options;
  options.image_size = kMattedSide;
  options.sources.data_dir = request.data;
  options.sources.filter.required_flags = {"cond_rendered"};
  if (!request.splits.empty()) {
    auto& ids = options.sources.filter.only.emplace();
    for (const fs::path& split : request.splits)
      ids.merge(data::read_split(data::file_of_dataset(split.string(), request.data), request.data));
  }
  options.picture_share = 0.0;
  options.background_share = request.backgrounds.empty() ? 0.0 : 0.5;
  if (!request.backgrounds.empty()) {
    options.scenes = std::make_shared<const std::vector<io::Image>>(
        data::read_pictures(request.backgrounds, 2 * kMattedSide, /*cut_out=*/false));
  }
  return std::make_unique<data::MattingDataset>(data::select(options.sources).train, options, request.seed);
}

/// The network of either kind.
class AnyMatting {
 public:
  explicit AnyMatting(const MattingOptions& options) {
    if (options.is_run()) {
      trained_ = std::make_unique<TrainedMatting>(options.network);
    } else {
      onnx_ = std::make_unique<MattingNetwork>(options);
    }
  }
  std::vector<std::uint8_t> mask(const io::Image& image, const std::string& name) {
    if (!trained_) return onnx_->mask(image);
    try {
      return trained_->mask(image, name);
    } catch (const InputError&) {  // it finds no object: a mask like any other, and a bad one
      return std::vector<std::uint8_t>(image.rgba.size() / io::kImageChannels, 0);
    }
  }

 private:
  std::unique_ptr<TrainedMatting> trained_;
  std::unique_ptr<MattingNetwork> onnx_;
};

io::Image gray_picture(const std::vector<std::uint8_t>& mask, int side) {
  io::Image image(side, side);
  for (std::size_t i = 0; i < mask.size(); ++i) {
    for (std::size_t c = 0; c < 3; ++c) image.rgba[io::kImageChannels * i + c] = mask[i];
    image.rgba[io::kImageChannels * i + 3] = 255;
  }
  return image;
}

double mean_of(const std::vector<MattingScore>& scores, double MattingScore::*value) {
  double sum = 0.0;
  for (const MattingScore& score : scores) sum += score.*value;
  return sum / static_cast<double>(scores.size());
}

eval::Interval interval_of(const std::vector<MattingScore>& scores, double MattingScore::*value, std::uint64_t seed) {
  std::vector<double> values;
  for (const MattingScore& score : scores) values.push_back(score.*value);
  return eval::bootstrap_mean(values, seed, "matting");
}

void write(const MattingEvaluation& result, const MattingEvaluationRequest& request,
           const std::vector<render::Tile>& tiles) {
  CsvTable rows{{"id", "method", "iou", "mae"}, {}};
  Json means = Json::object();
  for (std::size_t m = 0; m < result.methods.size(); ++m) {
    for (std::size_t i = 0; i < result.ids.size(); ++i) {
      const MattingScore& score = result.scores[m][i];
      rows.rows.push_back({result.ids[i], result.methods[m], fixed(score.iou, 6), fixed(score.mae, 6)});
    }
    means[result.methods[m]] = {{"iou", mean_of(result.scores[m], &MattingScore::iou)},
                                {"iou_interval", {result.iou[m].low, result.iou[m].high}},
                                {"mae", mean_of(result.scores[m], &MattingScore::mae)},
                                {"mae_interval", {result.mae[m].low, result.mae[m].high}}};
  }
  write_file_atomically(request.out / "metrics.csv", to_csv(rows));
  const Json all{{"settings", result.settings}, {"assets", result.ids.size()}, {"means", means}};
  write_file_atomically(request.out / "metrics.json", all.dump(2) + "\n");
  write_file_atomically(request.out / "table.md", to_markdown(result.table()) + "\n");
  if (tiles.empty()) return;
  render::SheetOptions sheet;
  sheet.columns = static_cast<int>(2 + result.methods.size());
  io::write_png(request.out / "samples.png", render::contact_sheet(tiles, sheet));
}

}  // namespace

MattingScore matting_score(const std::vector<std::uint8_t>& mask, const std::vector<float>& alpha) {
  if (mask.size() != alpha.size() || mask.empty()) throw InputError("", "mask", "differs in size from the true alpha");
  std::size_t both = 0, either = 0;
  MattingScore score;
  for (std::size_t i = 0; i < mask.size(); ++i) {
    const double found = mask[i] / 255.0;
    const bool a = found > 0.5, b = alpha[i] > 0.5F;
    both += a && b;
    either += a || b;
    score.mae += std::abs(found - static_cast<double>(alpha[i])) / static_cast<double>(mask.size());
  }
  score.iou = either == 0 ? 1.0 : static_cast<double>(both) / static_cast<double>(either);
  return score;
}

Table MattingEvaluation::table() const {
  Table table{{"method", "IoU ↑", "mean difference ↓"}, {}};
  const auto cell = [](double mean, const eval::Interval& interval) {
    return fixed(mean, 4) + " ± " + fixed(0.5 * (interval.high - interval.low), 4);
  };
  for (std::size_t m = 0; m < methods.size(); ++m) {
    table.rows.push_back({methods[m], cell(mean_of(scores[m], &MattingScore::iou), iou[m]),
                          cell(mean_of(scores[m], &MattingScore::mae), mae[m])});
  }
  return table;
}

MattingEvaluation evaluate_matting(const MattingEvaluationRequest& request) {
  AnyMatting network(request.matting);
  const auto pictures = composed_pictures(request);
  const std::size_t count = request.most == 0 ? pictures->assets() : std::min(request.most, pictures->assets());
  MattingEvaluation result;
  result.methods = {(request.matting.network / "x").parent_path().filename().string()};
  if (has_grabcut()) result.methods.emplace_back("GrabCut");
  result.scores.resize(result.methods.size());
  result.settings = {{"network", request.matting.network.string()},
                     {"splits", request.splits},
                     {"backgrounds", request.backgrounds.string()},
                     {"side", kMattedSide},
                     {"seed", request.seed}};
  std::vector<render::Tile> tiles;
  Progress progress("cutting out", count, "pictures");
  for (std::size_t i = 0; i < count; ++i) {
    throw_if_interrupted();
    const auto batch = pictures->load({data::Draw{pictures->item_of(i), i}});
    const auto& truth = dynamic_cast<const data::MattingBatch&>(*batch);
    const io::Image image = sparse_structure::picture_of_planes(truth.image[0]);
    const torch::Tensor flat = truth.alpha[0].contiguous().flatten();
    const std::vector<float> alpha(flat.data_ptr<float>(), flat.data_ptr<float>() + flat.numel());
    std::vector<std::vector<std::uint8_t>> masks{network.mask(image, batch->ids.front())};
    if (has_grabcut()) masks.push_back(grabcut_mask(image));
    for (std::size_t m = 0; m < masks.size(); ++m) result.scores[m].push_back(matting_score(masks[m], alpha));
    result.ids.push_back(pictures->asset(i).id);
    if (i < request.pictured) {
      tiles.push_back({image, short_id(batch->ids.front())});
      std::vector<std::uint8_t> bytes;
      for (const float value : alpha) bytes.push_back(static_cast<std::uint8_t>(255.0F * value + 0.5F));
      tiles.push_back({gray_picture(bytes, kMattedSide), "truth"});
      for (std::size_t m = 0; m < masks.size(); ++m) {
        const std::string caption = result.methods[m] + ", IoU " + fixed(result.scores[m].back().iou, 3);
        tiles.push_back({gray_picture(masks[m], kMattedSide), caption});
      }
    }
    progress.advance();
  }
  progress.finish();
  for (const std::vector<MattingScore>& scores : result.scores) {
    result.iou.push_back(interval_of(scores, &MattingScore::iou, request.seed));
    result.mae.push_back(interval_of(scores, &MattingScore::mae, request.seed));
  }
  write(result, request, tiles);
  return result;
}

}  // namespace anigen::generate
