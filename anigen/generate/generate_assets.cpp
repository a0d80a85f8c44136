#include "anigen/generate/generate_assets.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>
#include <memory>
#include <optional>
#include <system_error>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/hash.h"
#include "anigen/core/lease.h"
#include "anigen/core/log.h"
#include "anigen/core/numeric.h"
#include "anigen/core/process.h"
#include "anigen/core/run_folder.h"
#include "anigen/core/version.h"
#include "anigen/generate/assemble.h"
#include "anigen/generate/asset_maker.h"
#include "anigen/generate/latent_records.h"
#include "anigen/generate/voxel_file.h"
#include "anigen/geometry/primitives.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/io/gltf/export.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/obj.h"
#include "anigen/io/write_rigged.h"
#include "anigen/nn/profile.h"
#include "anigen/render/contact_sheet.h"
#include "anigen/render/picture.h"
#include "anigen/sparse_structure/voxel_picture.h"
#include "anigen/structured_latent/decoder.h"

namespace anigen::generate {

namespace {

namespace fs = std::filesystem;

constexpr const char* kReportFile = "generation.json";
constexpr const char* kLeases = ".leases";
// Files of an asset: always, of GenerateRequest::obj, of GenerateRequest::intermediate. The first two of the last kind
// are also what GenerationOptions::voxels_alone leaves.
constexpr const char* kAlways[] = {"mesh.glb",    "skeleton.glb", "processed_image.png", "processed_normal.png",
                                   "preview.png", kReportFile};
constexpr const char* kObj[] = {"mesh.obj", "mesh.rig.json"};
constexpr const char* kIntermediate[] = {"voxels.npz",  "voxels.png", "ss_latents.npz",
                                         "latents.npz", "votes.glb",  "dense.glb"};

/// Yaw and pitch of estimated cameras, degrees; yaw about Z from +X: -90 looks at the front.
Json camera_angles(const torch::Tensor& cameras) {
  const torch::Tensor rows = cameras.to(torch::kCPU, torch::kFloat64).contiguous();
  Json list = Json::array();
  for (std::int64_t i = 0; i < rows.size(0); ++i) {
    const double* row = rows[i].data_ptr<double>();
    list.push_back({{"yaw", std::atan2(row[0], row[1]) * 180.0 / kPi}, {"pitch", row[2] * 180.0 / kPi}});
  }
  return list;
}

/// Pictures of one size in a row.
io::Image side_by_side(const std::vector<io::Image>& pictures) {
  const int side = pictures.front().width, height = pictures.front().height;
  io::Image row(side * static_cast<int>(pictures.size()), height);
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    for (int y = 0; y < height; ++y) {
      std::copy_n(pictures[i].pixel(0, y), io::kImageChannels * static_cast<std::size_t>(side),
                  row.pixel(side * static_cast<int>(i), y));
    }
  }
  return row;
}

/// Pictures that the flows saw, their voxels, and the asset with its skeleton and its weights.
io::Image preview(const std::vector<io::Image>& pictures, const GeneratedAsset& made, const Asset& asset) {
  constexpr int kSide = 384;
  render::PictureOptions colors, bones, weights;
  for (render::PictureOptions* options : {&colors, &bones, &weights}) options->width = options->height = kSide;
  bones.mode = render::PictureMode::kNormals;
  bones.skeleton = true;
  weights.mode = render::PictureMode::kWeights;
  render::SheetOptions sheet;
  std::vector<render::Tile> cells;
  for (const io::Image& picture : pictures)
    cells.push_back({sparse_structure::fitted_picture(picture, kSide), "picture"});
  cells.push_back({sparse_structure::voxel_picture(made.voxels, kSide), "sparse structure"});
  cells.push_back({render::render(asset, colors), "asset"});
  cells.push_back({render::render(asset, bones), "skeleton"});
  cells.push_back({render::render(asset, weights), "skin weights"});
  constexpr std::size_t kMostColumns = 8;
  sheet.columns = static_cast<int>(std::min(cells.size(), kMostColumns));
  return render::contact_sheet(cells, sheet);
}

Json sampler_json(const SamplerOverrides& overrides) {
  Json json = Json::object();
  if (overrides.steps) json["steps"] = *overrides.steps;
  if (overrides.solver) json["solver"] = flow::word_of(*overrides.solver);
  if (overrides.cfg_strength) json["cfg_strength"] = *overrides.cfg_strength;
  if (overrides.cfg_interval) json["cfg_interval"] = {overrides.cfg_interval->first, overrides.cfg_interval->second};
  if (overrides.cfg_every) json["cfg_every"] = *overrides.cfg_every;
  if (overrides.velocity_tolerance) json["velocity_tolerance"] = *overrides.velocity_tolerance;
  if (overrides.windowed_steps) json["windowed_steps"] = *overrides.windowed_steps;
  return json;
}

/// Fingerprint of the files that a result was made from, by name, size and time of the last change: the picture and
/// what belongs to it, every run's config and weights. Their bytes are gigabytes.
std::string inputs_of(const GenerateRequest& request, const std::vector<fs::path>& runs, const NamedPicture& picture) {
  const MattingOptions& matting = request.pictures.matting;
  std::vector<fs::path> files{
      picture.file, picture.mask, request.voxels, picture.normal_map, request.estimator_weights, matting.network};
  for (const NamedPicture& view : picture.others) files.insert(files.end(), {view.file, view.normal_map});
  std::vector<fs::path> folders = runs;
  if (matting.is_run()) folders.push_back(matting.network);
  for (const fs::path& run : folders) {
    const RunFolder folder{run};
    files.push_back(folder.config());
    for (const std::string& name : io::checkpoint_names(folder.checkpoints()))
      files.push_back(folder.checkpoints() / name);
  }
  std::string seen;
  std::error_code error;
  for (const fs::path& file : files) {
    if (!fs::is_regular_file(file, error)) continue;
    seen += file.string() + "|" + std::to_string(fs::file_size(file, error)) + "|" +
            std::to_string(fs::last_write_time(file, error).time_since_epoch().count()) + "\n";
  }
  return sha256(seen);
}

// Words of the enums, in their order.
constexpr const char* kConditions[] = {"trained", "color", "normal"};
constexpr const char* kAverages[] = {"usual", "always", "never"};

class Generation {
 public:
  explicit Generation(const GenerateRequest& request)
      : request_(request), maker_(request), sampling_(request.sampling) {
    if (request.voxels.empty()) return;
    const AssetGenerator& generator = maker_.generator();
    sampling_.given_voxels =
        voxels_of_npz(read_file(request.voxels), request.voxels.string(), generator.grid(), !generator.shape_alone());
  }

  /// An asset that was made before, here or by another process, of these inputs.
  std::optional<GenerationReport> kept(const NamedPicture& picture, const std::string& name) const {
    GenerationReport report = report_of(name);
    if (request_.again || !is_there(report, generation_settings(request_, maker_.generator().runs(), picture)))
      return std::nullopt;
    for (const std::string file : kIntermediate) {
      std::error_code error;
      if (file == "ss_latents.npz" && sampling_.given_voxels) continue;
      if (file == "votes.glb" && maker_.generator().shape_alone()) continue;
      if (request_.intermediate && !fs::is_regular_file(report.folder / file, error)) return std::nullopt;
    }
    return report;
  }

  /// Refuses to mix what this build makes with what another one made of equal inputs, before anything is made.
  /// @throws InputError naming both
  void require_own_code(const std::vector<NamedPicture>& pictures, const std::vector<std::string>& names) const {
    if (request_.accept_other_code) return;
    std::size_t count = 0;
    GenerationReport first;
    for (std::size_t i = 0; i < pictures.size(); ++i) {
      GenerationReport report = kept(pictures[i], names[i]).value_or(GenerationReport{});
      if (!report.kept || commit_of(report.details) == commit()) continue;
      if (count++ == 0) first = std::move(report);
    }
    if (count == 0) return;
    throw InputError((first.folder / kReportFile).string(), "/made_by/commit",
                     "was made by " + named_commit(commit_of(first.details)) +
                         (count > 1 ? ", and so are " + std::to_string(count - 1) + " more" : "") + "; this is " +
                         named_commit(commit()) + ": --force makes them anew, --accept-other-code keeps them");
  }

  GenerationReport run(const NamedPicture& picture, const std::string& name) {
    GenerationReport report = report_of(name);
    report_failures(report, [&] {
      if (request_.started) request_.started(picture);
      make(picture, generation_settings(request_, maker_.generator().runs(), picture), report);
    });
    return report;
  }

  /// The asset alone, in the file that the request names.
  GenerationReport run_to_file(const NamedPicture& picture, const std::string& name) {
    GenerationReport report;
    report.name = name;
    report.file = request_.output;
    report_failures(report, [&] {
      if (request_.started) request_.started(picture);
      const auto started = std::chrono::steady_clock::now();
      const MadeAsset result = maker_.make(picture, name, sampling_);
      report.details = details_of(result, generation_settings(request_, maker_.generator().runs(), picture));
      io::write_rigged(report.file, result.finished.asset, export_options());
      add_counts(result, report.details);
      add_seconds(result.generated.times, started, report.details);
    });
    return report;
  }

 private:
  template <typename Work>
  static void report_failures(GenerationReport& report, const Work& work) {
    try {
      work();
    } catch (...) {
      report.failure = failure_of_item();
      report.details = Json();
    }
    if (!report.failure.empty()) log::warn("{}: {}", report.name, report.failure);
  }

  static Json details_of(const MadeAsset& result, const Json& settings) {
    const GeneratedAsset& made = result.generated;
    return {{"made_by", made_by()},
            {"settings", settings},
            {"notices", result.notices},
            {"voxels", {{"shape", made.shape_voxels}, {"skeleton", made.skeleton_voxels}}}};
  }

  static void add_counts(const MadeAsset& result, Json& details) {
    const Asset& asset = result.finished.asset;
    details["joints"] = asset.skeleton.size();
    details["vertices"] = asset.mesh.vertices.size();
    details["faces"] = asset.mesh.faces.size();
    if (result.generated.cameras) details["cameras"] = camera_angles(*result.generated.cameras);
    if (!result.finished.rigid_parts.is_null()) details["rigid_parts"] = result.finished.rigid_parts;
  }

  static void add_seconds(const GenerationTimes& times, std::chrono::steady_clock::time_point started, Json& details) {
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - started;
    details["seconds"] = {{"condition", times.condition},
                          {"structure", times.structure},
                          {"latents", times.latents},
                          {"decode", times.decode},
                          {"all", seconds.count()}};
  }

  io::ExportOptions export_options() const {
    io::ExportOptions options;
    if (request_.published_axes) options.axes = io::ExportAxes::kPublished;
    return options;
  }

  GenerationReport report_of(const std::string& name) const {
    GenerationReport report;
    report.name = name;
    report.folder = request_.output / name;
    return report;
  }

  static bool is_there(GenerationReport& report, const Json& settings) {
    Json found;
    try {
      found = read_json(report.folder / kReportFile);
    } catch (const InputError&) {
      return false;  // missing, damaged, or taken away by another process that makes the asset anew
    }
    if (!found.is_object() || found.value("settings", Json()) != settings) return false;
    report.details = found;
    report.kept = true;
    return true;
  }

  void make(const NamedPicture& picture, const Json& settings, GenerationReport& report) {
    remove_lastingly(report.folder / kReportFile);
    std::error_code error;
    for (const char* stale : kObj) fs::remove(report.folder / stale, error);
    for (const char* stale : kIntermediate) fs::remove(report.folder / stale, error);
    if (sampling_.voxels_alone) {
      for (const char* stale : kAlways) fs::remove(report.folder / stale, error);
    }
    const auto started = std::chrono::steady_clock::now();
    const MadeAsset result = maker_.make(picture, report.name, sampling_);
    const GeneratedAsset& made = result.generated;
    io::write_png(report.folder / "processed_image.png", side_by_side(result.pictures));
    if (!result.normals.empty()) io::write_png(report.folder / "processed_normal.png", side_by_side(result.normals));
    if (request_.intermediate || sampling_.voxels_alone) {
      write_file_atomically(report.folder / "voxels.npz", npz_of_voxels(made.voxels));
      io::write_png(report.folder / "voxels.png", sparse_structure::voxel_picture(made.voxels, 512));
    }
    report.details = details_of(result, settings);
    if (!sampling_.voxels_alone) write_asset(result, report);
    add_seconds(made.times, started, report.details);
    write_file_atomically(report.folder / kReportFile, report.details.dump(2) + "\n");
  }

  /// Everything that the first flow alone does not give.
  void write_asset(const MadeAsset& result, GenerationReport& report) {
    const GeneratedAsset& made = result.generated;
    const FinishedAsset& finished = result.finished;
    const io::ExportOptions axes = export_options();
    io::write_gltf(report.folder / "mesh.glb", finished.asset, axes);
    if (request_.obj) io::write_obj_rig(report.folder / "mesh.obj", finished.asset, axes.axes);
    io::write_gltf(report.folder / "skeleton.glb", geometry::skeleton_asset(finished.asset.skeleton), axes);
    io::write_png(report.folder / "preview.png", preview(result.pictures, made, finished.asset));
    if (request_.intermediate) {
      io::write_gltf(report.folder / "dense.glb", made.decoded.asset, axes);
      if (!maker_.generator().shape_alone()) write_votes(report.folder / "votes.glb", made.decoded.votes);
      if (!sampling_.given_voxels) {
        write_structure_latents(report.folder / "ss_latents.npz", made.structure[0][0], made.structure[1][0],
                                request_.models.structure_flow);
      }
      write_structured_latents(report.folder / "latents.npz", made.latents, request_.models.latent_flow);
    }
    add_counts(result, report.details);
  }

  const GenerateRequest& request_;
  AssetMaker maker_;
  GenerationOptions sampling_;
};

/// Stale files are removed, too, so all names count, whatever is asked for.
std::vector<fs::path> outputs_of(const GenerateRequest& request, const std::vector<std::string>& names) {
  std::vector<fs::path> outputs;
  for (const std::string& name : names) {
    for (const char* file : kAlways) outputs.push_back(request.output / name / file);
    for (const char* file : kObj) outputs.push_back(request.output / name / file);
    for (const char* file : kIntermediate) outputs.push_back(request.output / name / file);
  }
  return outputs;
}

void refuse_lossy_outputs(const GenerateRequest& request, const std::vector<NamedPicture>& pictures,
                          const std::vector<fs::path>& outputs) {
  refuse_to_overwrite(outputs, [&] {
    std::vector<fs::path> inputs = {request.estimator_weights, request.pictures.matting.network, request.voxels};
    for (const NamedPicture& picture : pictures) {
      inputs.insert(inputs.end(), {picture.file, picture.normal_map, picture.mask});
      for (const NamedPicture& view : picture.others) inputs.insert(inputs.end(), {view.file, view.normal_map});
    }
    return inputs;
  });
}

}  // namespace

Json generation_settings(const GenerateRequest& request, const std::vector<fs::path>& runs,
                         const NamedPicture& picture) {
  const FinishingOptions finishing = finishing_of_flow(request.finishing, runs[1]);
  const auto grouping = grouping_of_flow(request.models.grouping, runs[1], runs[3]);
  Json settings = {{"picture", fs::absolute(picture.file).lexically_normal().string()},
                   {"ss_flow", runs[0].string()},
                   {"slat_flow", runs[1].string()},
                   {"ss_dae", runs[2].string()},
                   {"slat_dae", runs[3].string()},
                   {"inputs", inputs_of(request, runs, picture)},
                   {"background", word_of(kBackgroundWords, request.pictures.background)},
                   {"normals", word_of(kNormalSourceWords, request.pictures.normals)},
                   {"estimator_side", request.pictures.estimator_side},
                   {"condition", kConditions[static_cast<int>(request.models.structure_condition)]},
                   {"seed", request.sampling.seed},
                   {"joints", request.sampling.joints},
                   {"grouping_bandwidth", grouping.bandwidth},
                   {"grouping_least_votes", grouping.min_cluster_size},
                   {"structure_sampler", sampler_json(request.sampling.structure)},
                   {"latent_sampler", sampler_json(request.sampling.latents)},
                   {"averages", kAverages[static_cast<int>(request.models.averages)]},
                   {"precision", word_of(nn::kFlowPrecisions, request.models.precision)},
                   {"picture_colors", request.picture_colors},
                   {"idle", request.idle},
                   {"published_axes", request.published_axes},
                   {"obj", request.obj},
                   {"finishing",
                    {{"reduction", finishing.reduction},
                     {"remove_hidden", finishing.remove_hidden},
                     {"views", finishing.views},
                     {"view_size", finishing.view_size},
                     {"filter_skin", finishing.filter_skin},
                     {"smoothing_iterations", finishing.smoothing_iterations.value_or(kPublishedSmoothing)},
                     {"smoothing_alpha", finishing.smoothing_alpha},
                     {"texture_size", finishing.texture_size}}}};
  if (grouping.form != skeleton_field::MeanShiftForm::kOfRun)
    settings["grouping"] = grouping.form == skeleton_field::MeanShiftForm::kPaper ? "paper" : "published";
  if (!picture.mask.empty()) settings["mask"] = fs::absolute(picture.mask).lexically_normal().string();
  if (request.sampling.voxels_alone) settings["stop_at"] = "voxels";
  if (!request.voxels.empty()) settings["voxels"] = fs::absolute(request.voxels).lexically_normal().string();
  if (finishing.rigid_parts) settings["finishing"]["rigid_share"] = finishing.rigid_share;
  if (!picture.others.empty()) {
    settings["view_rule"] = word_of(flow::kViewRuleWords, request.sampling.views);
    for (const NamedPicture& view : picture.others)
      settings["other_views"].push_back(fs::absolute(view.file).lexically_normal().string());
  }
  const MattingOptions& matting = request.pictures.matting;
  if (matting.is_run()) {
    settings["matting"] = {{"run", matting.network.string()}};
  } else if (!matting.network.empty()) {
    settings["matting"] = {
        {"network", matting.network.string()}, {"mean", matting.mean}, {"deviation", matting.deviation}};
  }
  return settings;
}

std::vector<GenerationReport> generate_assets(const GenerateRequest& request,
                                              const std::vector<NamedPicture>& pictures) {
  request.finishing.validate();
  if (!request.name.empty() && pictures.size() != 1) throw InputError("", "--asset-name", "is for one image");
  if (!request.voxels.empty() && pictures.size() != 1) throw InputError("", "--voxels", "are those of one image");
  require_distinct_names(pictures);
  std::vector<std::string> names;
  for (const NamedPicture& picture : pictures) names.push_back(request.name.empty() ? picture.name : request.name);
  refuse_lossy_outputs(request, pictures, outputs_of(request, names));
  Generation generation(request);
  generation.require_own_code(pictures, names);
  std::vector<GenerationReport> reports(pictures.size());
  const LeaseFolder leases(request.output / kLeases);
  work_in_turn(
      leases, names,
      [&](std::size_t i) {
        std::optional<GenerationReport> kept = generation.kept(pictures[i], names[i]);
        if (kept) reports[i] = std::move(*kept);
        return kept.has_value();
      },
      [&](std::size_t i) { reports[i] = generation.run(pictures[i], names[i]); });
  leases.remove_left();
  return reports;
}

GenerationReport generate_file(const GenerateRequest& request, const NamedPicture& picture) {
  request.finishing.validate();
  if (!io::is_rigged_output(request.output))
    throw InputError(request.output.string(), "--output", "a generated asset is a .glb, .gltf, .fbx, .usda or .usdz");
  if (request.obj || request.intermediate || request.sampling.voxels_alone)
    throw InputError(request.output.string(), "--output", "one file has no room for other results; name a folder");
  refuse_lossy_outputs(request, {picture}, {request.output});
  return Generation(request).run_to_file(picture, request.name.empty() ? picture.name : request.name);
}

Json to_json(const std::vector<GenerationReport>& reports) {
  Json list = Json::array();
  for (const GenerationReport& report : reports) {
    Json one = report.details.is_object() ? report.details : Json::object();
    one["name"] = report.name;
    if (report.file.empty())
      one["folder"] = report.folder.string();
    else
      one["file"] = report.file.string();
    if (!report.failure.empty()) one["failure"] = report.failure;
    list.push_back(std::move(one));
  }
  return list;
}

std::string to_text(const std::vector<GenerationReport>& reports) {
  std::string text;
  for (const GenerationReport& report : reports) {
    text += report.name + ": ";
    if (!report.failure.empty()) {
      text += report.failure + "\n";
      continue;
    }
    const Json& details = report.details;
    const auto count = [](const Json& of, const char* what) {
      return std::to_string(of.value(what, std::size_t{0})) + " " + what;
    };
    text += report.file.empty() ? report.folder.string() + (details.contains("joints") ? "/mesh.glb" : "")
                                : report.file.string();
    text +=
        details.contains("joints")
            ? ", " + count(details, "joints") + ", " + count(details, "vertices") + ", " + count(details, "faces")
            : "/voxels.npz, voxels: " + count(details["voxels"], "shape") + ", " + count(details["voxels"], "skeleton");
    text += report.kept ? ", was there\n"
                        : ", " + std::to_string(static_cast<int>(details["seconds"].value("all", 0.0))) + " s\n";
    if (report.kept) continue;
    for (const auto& notice : details["notices"]) text += "  " + notice.get<std::string>() + "\n";
  }
  return text;
}

}  // namespace anigen::generate
