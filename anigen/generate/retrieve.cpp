#include "anigen/generate/retrieve.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"
#include "anigen/core/process.h"
#include "anigen/core/version.h"
#include "anigen/generate/preprocess.h"
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

/// The condition views of a data set's assets.
class Gallery {
 public:
  explicit Gallery(const RetrievalRequest& request) : source_(request.dataset), folder_(request.dataset) {
    for (const std::string& id : io::select_ids(source_, request.splits)) {
      if (!source_.is_usable(id)) continue;
      std::error_code error;
      if (fs::is_regular_file(folder_ / "renders_cond" / id / "transforms.json", error)) ids_.push_back(id);
    }
    if (ids_.empty()) {
      throw InputError(folder_.string(), "renders_cond",
                       "no asset has condition views; anigen-prepare --cond-views makes them");
    }
    look(request.views, request.seen);
  }

  struct Nearest {
    std::string id;
    double distance;
  };
  /// @param cells [1, C]
  Nearest nearest(const Tensor& cells) const {
    const Tensor distances = (cells_ - cells).square().mean(1);
    const std::int64_t row = distances.argmin().item<std::int64_t>();
    return {ids_[owners_[static_cast<std::size_t>(row)]], std::sqrt(distances[row].item<double>())};
  }

  void write(const std::string& id, const fs::path& file) const {
    const fs::path own = folder_ / "assets" / (id + ".glb");
    std::error_code error;
    if (fs::is_regular_file(own, error)) {
      write_file_atomically(file, read_file(own));
    } else {
      io::write_gltf(file, io::to_asset(source_.read(id)));
    }
  }

 private:
  /// Cells of the first views of an asset.
  static std::vector<Tensor> seen(const fs::path& folder, std::size_t most, data::ConditionPictures pictures) {
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
      const io::Image object = vision::inference_image(view, kSide, file.string());
      views.push_back(picture_cells(vision::color_tensor(object).unsqueeze(0)));
    }
    return views;
  }

  void look(std::size_t most, data::ConditionPictures pictures) {
    std::vector<std::vector<Tensor>> views(ids_.size());
    Progress progress("looking at the data set", ids_.size(), "assets");
    parallel_for(ids_.size(), [&](std::size_t i) {
      throw_if_interrupted();
      try {
        views[i] = seen(folder_ / "renders_cond" / ids_[i], most, pictures);
      } catch (...) {
        log::warn("left out {}: {}", ids_[i], failure_of_item());
      }
      progress.advance();
    });
    progress.finish();
    std::vector<Tensor> rows;
    for (std::size_t i = 0; i < views.size(); ++i) {
      for (Tensor& view : views[i]) {
        rows.push_back(std::move(view));
        owners_.push_back(i);
      }
    }
    if (rows.empty()) throw InputError(folder_.string(), "renders_cond", "holds no usable view");
    cells_ = torch::cat(rows);
  }

  io::DatasetSource source_;
  fs::path folder_;
  std::vector<std::string> ids_;
  std::vector<std::size_t> owners_;  // of the rows, indices of ids_
  Tensor cells_;                     // [views of all, C]
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
  options.size = kSide;
  const bool normals = request.seen == data::ConditionPictures::kNormals;
  options.normals = normals ? NormalSource::kFile : NormalSource::kColors;
  refuse_lossy_outputs(request, pictures);
  ImagePreprocessor preprocessor(options);
  const Gallery gallery(request);
  std::vector<RetrievalReport> reports;
  for (const NamedPicture& picture : pictures) {
    throw_if_interrupted();
    RetrievalReport report;
    report.name = picture.name;
    report.file = request.output / report.name / kMeshFile;
    try {
      const PreprocessedImage seen = preprocessor.run(picture.file, picture.normal_map);
      const Gallery::Nearest nearest = gallery.nearest(picture_cells(seen.normals_tensor));
      report.asset = nearest.id;
      report.distance = nearest.distance;
      gallery.write(nearest.id, report.file);
      const Json details = {{"made_by", made_by()},
                            {"retrieved", nearest.id},
                            {"distance", nearest.distance},
                            {"compared", normals ? "normals" : "colours"},
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
    std::snprintf(distance, sizeof distance, ", colours differ by %.3f\n", report.distance);
    text += report.name + ": " + (report.failure.empty() ? report.asset + distance : report.failure + "\n");
  }
  return text;
}

}  // namespace anigen::generate
