#include "anigen/generate/retrieve.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"
#include "anigen/core/process.h"
#include "anigen/core/version.h"
#include "anigen/generate/preprocess.h"
#include "anigen/generate/stage_generators.h"
#include "anigen/io/gltf/export.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/render/cameras_json.h"

namespace anigen::generate {

namespace {

namespace fs = std::filesystem;
using torch::Tensor;

constexpr int kSide = 112;  // pixels to which pictures are reduced first
constexpr const char* kMeshFile = "mesh.glb";
constexpr const char* kRecordFile = "generation.json";

/// Description of pictures by which they are compared.
class Describer {
 public:
  explicit Describer(const RetrievalRequest& request) : seen_(request.seen) {
    if (request.encoder.empty()) return;
    StructureGenerator::Request flow;
    flow.run = request.encoder;
    flow.device = request.device;
    flow_ = std::make_unique<StructureGenerator>(flow);
    seen_ = flow_->reading().condition;
    side_ = flow_->reading().image_size;
  }

  int side() const { return side_; }
  data::ConditionPictures seen() const { return seen_; }
  const char* name() const {
    if (flow_) return "tokens of a trained encoder";
    return seen_ == data::ConditionPictures::kNormals ? "normals" : "colours";
  }

  /// @param pictures [B, 3, S, S], S = side() @return [B, C]; of an encoder in half precision: there may be many
  Tensor operator()(const Tensor& pictures) const {
    if (!flow_) return picture_cells(pictures);
    const Tensor tokens = flow_->condition(pictures).to(torch::kCPU).flatten(1);
    return (tokens / tokens.norm(2, {1}, /*keepdim=*/true).clamp_min(1e-12)).to(torch::kHalf);
  }
  /// False when pictures may be described on several threads at once.
  bool has_network() const { return flow_ != nullptr; }

 private:
  std::unique_ptr<StructureGenerator> flow_;
  data::ConditionPictures seen_;
  int side_ = kSide;
};

/// The condition views of a data set's assets.
class Gallery {
 public:
  Gallery(const RetrievalRequest& request, const Describer& describe)
      : source_(request.dataset), folder_(request.dataset) {
    for (const std::string& id : io::select_ids(source_, request.splits)) {
      if (!source_.is_usable(id)) continue;
      std::error_code error;
      if (fs::is_regular_file(folder_ / "renders_cond" / id / "transforms.json", error)) ids_.push_back(id);
    }
    if (ids_.empty()) {
      throw InputError(folder_.string(), "renders_cond",
                       "no asset has condition views; anigen-prepare --cond-views makes them");
    }
    look(request.views, describe);
  }

  struct Nearest {
    std::string id;
    double distance;
  };
  /// @param described [1, C]
  Nearest nearest(const Tensor& described) const {
    // By blocks: differences in fp32 of all rows may not fit into memory.
    constexpr std::int64_t kBlock = 1024;
    Nearest nearest{"", std::numeric_limits<double>::infinity()};
    for (std::int64_t first = 0; first < rows_.size(0); first += kBlock) {
      const Tensor block = rows_.slice(0, first, first + kBlock).to(torch::kFloat32);
      const Tensor distances = (block - described.to(torch::kFloat32)).square().mean(1);
      const std::int64_t row = distances.argmin().item<std::int64_t>();
      const double distance = std::sqrt(distances[row].item<double>());
      if (distance < nearest.distance) nearest = {ids_[owners_[static_cast<std::size_t>(first + row)]], distance};
    }
    return nearest;
  }

  void write(const std::string& id, const fs::path& file) const {
    const fs::path own = folder_ / "assets" / (id + ".glb");
    std::error_code error;
    if (fs::is_regular_file(own, error)) {
      write_file_atomically(file, read_file(own));
    } else {
      Asset asset = io::to_asset(source_.read(id));
      asset.skeleton = io::unrotated_in_file(asset.skeleton, io::ExportAxes::kGltf);
      io::write_gltf(file, asset);
    }
  }

 private:
  /// The first views of an asset, [V, 3, S, S].
  static Tensor seen(const fs::path& folder, std::size_t most, data::ConditionPictures pictures, int side) {
    const auto frames = render::read_transforms(folder / "transforms.json").frames;
    const std::size_t count = most == 0 ? frames.size() : std::min(most, frames.size());
    std::vector<Tensor> views;
    for (std::size_t f = 0; f < count; ++f) {
      const fs::path file = folder / frames[f].file_path;
      io::Image view = io::read_image(file);
      if (pictures == data::ConditionPictures::kNormals) {
        const fs::path map = data::normal_picture_of(file);
        view = with_alpha_of(supplied_normals(io::read_image(map), view.width, view.height, map.string()), view);
      }
      views.push_back(vision::color_tensor(vision::inference_image(view, side, file.string())));
    }
    return torch::stack(views);
  }

  // A bundle of assets is read on all threads, then described.
  void look(std::size_t most, const Describer& describe) {
    Progress progress("looking at the data set", ids_.size(), "assets");
    std::vector<Tensor> rows;
    for (std::size_t first = 0; first < ids_.size(); first += kBundle) {
      const std::size_t count = std::min(kBundle, ids_.size() - first);
      std::vector<Tensor> views(count);
      parallel_for(count, [&](std::size_t i) {
        throw_if_interrupted();
        const std::string& id = ids_[first + i];
        try {
          views[i] = seen(folder_ / "renders_cond" / id, most, describe.seen(), describe.side());
          if (!describe.has_network()) views[i] = describe(views[i]);
        } catch (...) {
          log::warn("left out {}: {}", id, failure_of_item());
          views[i] = Tensor();
        }
        progress.advance();
      });
      for (std::size_t i = 0; i < count; ++i) {
        if (!views[i].defined()) continue;
        owners_.insert(owners_.end(), static_cast<std::size_t>(views[i].size(0)), first + i);
        rows.push_back(describe.has_network() ? describe(views[i]) : views[i]);
      }
    }
    progress.finish();
    if (rows.empty()) throw InputError(folder_.string(), "renders_cond", "holds no usable view");
    rows_ = torch::cat(rows);
  }

  static constexpr std::size_t kBundle = 256;

  io::DatasetSource source_;
  fs::path folder_;
  std::vector<std::string> ids_;
  std::vector<std::size_t> owners_;  // of the rows, indices of ids_
  Tensor rows_;                      // [views of all, C]
};

void refuse_lossy_outputs(const RetrievalRequest& request, const std::vector<NamedPicture>& pictures) {
  std::vector<fs::path> outputs;
  for (const NamedPicture& picture : pictures) {
    for (const char* file : {kMeshFile, kRecordFile}) outputs.push_back(request.output / picture.name / file);
  }
  refuse_to_overwrite(outputs, [&] {
    std::vector<fs::path> inputs = request.splits;
    for (const NamedPicture& picture : pictures) {
      inputs.push_back(picture.file);
      inputs.push_back(picture.normal_map);
    }
    const io::DatasetSource source(request.dataset);
    for (const std::string& id : source.ids()) {
      for (fs::path& file : source.files(id)) inputs.push_back(std::move(file));
    }
    return inputs;
  });
}

}  // namespace

std::vector<RetrievalReport> retrieve_assets(const RetrievalRequest& request,
                                             const std::vector<NamedPicture>& pictures) {
  require_distinct_names(pictures);
  PreprocessingOptions options = request.pictures;
  const Describer describe(request);
  options.size = describe.side();
  const bool normals = describe.seen() == data::ConditionPictures::kNormals;
  options.normals = normals ? NormalSource::kFile : NormalSource::kColors;
  refuse_lossy_outputs(request, pictures);
  ImagePreprocessor preprocessor(options);
  const Gallery gallery(request, describe);
  std::vector<RetrievalReport> reports;
  for (const NamedPicture& picture : pictures) {
    throw_if_interrupted();
    RetrievalReport report;
    report.name = picture.name;
    report.file = request.output / report.name / kMeshFile;
    try {
      const PreprocessedImage seen = preprocessor.run(picture);
      const Gallery::Nearest nearest = gallery.nearest(describe(seen.normals_tensor));
      report.asset = nearest.id;
      report.distance = nearest.distance;
      gallery.write(nearest.id, report.file);
      const Json details = {{"made_by", made_by()},
                            {"retrieved", nearest.id},
                            {"distance", nearest.distance},
                            {"compared", describe.name()},
                            {"dataset", fs::absolute(request.dataset).lexically_normal().string()}};
      write_file_atomically(report.file.parent_path() / kRecordFile, details.dump(2) + "\n");
    } catch (...) {
      report.failure = failure_of_item();
      log::warn("{}: {}", report.name, report.failure);
    }
    reports.push_back(std::move(report));
  }
  return reports;
}

Json to_json(const std::vector<RetrievalReport>& reports) {
  Json list = Json::array();
  for (const RetrievalReport& report : reports) {
    Json one = {{"name", report.name}, {"file", report.file.string()}};
    if (report.failure.empty()) {
      one["asset"] = report.asset;
      one["distance"] = report.distance;
    } else {
      one["failure"] = report.failure;
    }
    list.push_back(std::move(one));
  }
  return list;
}

std::string to_text(const std::vector<RetrievalReport>& reports) {
  std::string text;
  for (const RetrievalReport& report : reports) {
    char distance[48];
    std::snprintf(distance, sizeof distance, ", %.3f apart\n", report.distance);
    text += report.name + ": " + (report.failure.empty() ? report.asset + distance : report.failure + "\n");
  }
  return text;
}

}  // namespace anigen::generate
