#include "anigen/prepare/steps/view_step.h"

#include <cstdio>
#include <functional>
#include <system_error>

#include "anigen/core/atomic_file.h"
#include "anigen/core/random.h"
#include "anigen/io/image.h"
#include "anigen/io/ply.h"
#include "anigen/raytrace/scene.h"
#include "anigen/raytrace/views/render_view.h"
#include "anigen/raytrace/views/transforms_json.h"
#include "anigen/raytrace/views/view_encoding.h"

namespace anigen::prepare {
namespace {

namespace fs = std::filesystem;

Json step_options(const ViewSettings& settings) {
  Json json{{"count", settings.count},
            {"size", settings.size},
            {"samples", settings.samples_per_axis},
            {"geometry", settings.geometry},
            {"seed", settings.seed}};
  // Said only where it holds, so that the records of data sets made before there was a choice still fit.
  if (settings.front) json["front"] = true;
  return json;
}

/// "007.png" and, for an aspect, "007_normal.png".
std::string picture_name(std::size_t index, const std::string& aspect = "") {
  char number[24];
  std::snprintf(number, sizeof number, "%03zu", index);
  return number + (aspect.empty() ? "" : "_" + aspect) + ".png";
}

/// @param aspects further pictures of each view, where the options ask for geometry
std::vector<fs::path> view_files(const fs::path& folder, const Json& options, const std::vector<std::string>& aspects) {
  std::vector<fs::path> files{folder / "transforms.json"};
  const bool geometry = options.value("geometry", false);
  for (std::size_t i = 0; i < options.value("count", std::size_t{0}); ++i) {
    files.push_back(folder / picture_name(i));
    if (!geometry) continue;
    for (const std::string& aspect : aspects) files.push_back(folder / picture_name(i, aspect));
  }
  return files;
}

void clear_folder(const fs::path& folder) {
  std::error_code ignored;
  fs::remove_all(folder, ignored);
}

raytrace::ViewOptions view_options(const ViewSettings& settings) {
  raytrace::ViewOptions options;
  options.size = settings.size;
  options.samples_per_axis = settings.samples_per_axis;
  return options;
}

/// Cameras are drawn from a stream of the asset's own, so that they do not depend on what else is prepared.
Rng camera_rng(const ViewSettings& settings, const std::string& purpose, const std::string& id) {
  return Rng(settings.seed, purpose + "/" + id);
}

void write_bytes(const fs::path& file, const std::vector<std::uint8_t>& bytes) {
  write_file_atomically(file, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
}

/// Called for every view with its number, to write what else is wanted of it.
using OtherPictures = std::function<void(const raytrace::ViewImages&, const raytrace::Frame&, std::size_t)>;

void render_views(AssetJob& job, raytrace::ViewOptions options, const std::vector<raytrace::ViewCamera>& cameras,
                  const fs::path& folder, const OtherPictures& others) {
  const raytrace::Scene scene(job.asset());
  const raytrace::ViewRenderer renderer(scene);
  raytrace::Transforms transforms = raytrace::make_transforms(cameras, job.normalisation());
  for (std::size_t i = 0; i < transforms.frames.size(); ++i) {
    raytrace::Frame& frame = transforms.frames[i];
    frame.file_path = picture_name(i);
    const raytrace::ViewImages images = renderer.render(frame, options);
    io::write_png(folder / frame.file_path, images.color);
    others(images, frame, i);
  }
  // Last: whoever finds it finds all pictures it names.
  raytrace::write_transforms(folder / "transforms.json", transforms);
}

}  // namespace

Json ViewStep::options() const { return step_options(settings_); }

std::vector<fs::path> ViewStep::outputs(const AssetPlaces& places, const Json& options) const {
  std::vector<fs::path> files = view_files(places.views(), options, {"normal", "depth"});
  files.push_back(places.views() / "mesh.ply");
  return files;
}

void ViewStep::clear(const AssetPlaces& places) const { clear_folder(places.views()); }

Json ViewStep::run(AssetJob& job) const {
  const Asset& asset = job.asset();
  Rng rng = camera_rng(settings_, "feature views", job.id());
  const double offset0 = rng.uniform(), offset1 = rng.uniform();
  Mesh plain;
  plain.vertices = asset.mesh.vertices;
  plain.faces = asset.mesh.faces;
  io::write_ply(job.places().views() / "mesh.ply", plain);
  raytrace::ViewOptions options = view_options(settings_);
  options.geometry = settings_.geometry;
  const fs::path folder = job.places().views();
  render_views(job, options, raytrace::feature_views(settings_.count, offset0, offset1), folder,
               [&](const raytrace::ViewImages& images, const raytrace::Frame&, std::size_t i) {
                 if (!settings_.geometry) return;
                 io::write_png(folder / picture_name(i, "normal"), raytrace::encode_world_normals(images));
                 write_bytes(folder / picture_name(i, "depth"), raytrace::encode_depth_png(images));
               });
  return {{"views", settings_.count}};
}

Json ConditionViewStep::options() const { return step_options(settings_); }

std::vector<fs::path> ConditionViewStep::outputs(const AssetPlaces& places, const Json& options) const {
  return view_files(places.condition_views(), options, {"normal"});
}

void ConditionViewStep::clear(const AssetPlaces& places) const { clear_folder(places.condition_views()); }

Json ConditionViewStep::run(AssetJob& job) const {
  Rng rng = camera_rng(settings_, "condition views", job.id());
  raytrace::ViewOptions options = view_options(settings_);
  options.mean_normal = settings_.geometry;
  const fs::path folder = job.places().condition_views();
  const auto cameras =
      settings_.front ? raytrace::front_views(settings_.count, rng) : raytrace::condition_views(settings_.count, rng);
  render_views(job, options, cameras, folder,
               [&](const raytrace::ViewImages& images, const raytrace::Frame& frame, std::size_t i) {
                 if (!settings_.geometry) return;
                 io::write_png(folder / picture_name(i, "normal"), raytrace::encode_condition_normals(images, frame));
               });
  return {{"cond_views", settings_.count}};
}

}  // namespace anigen::prepare
