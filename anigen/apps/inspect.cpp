#include <cstdio>

#include "anigen/apps/common/command_line.h"
#include "anigen/apps/common/torch_half.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/process.h"
#include "anigen/eval/describe.h"
#include "anigen/eval/inspect.h"
#include "anigen/io/rigs/rig_listing.h"

namespace {

using namespace anigen;

struct InspectOptions {
  std::vector<std::string> files;
  std::string picture, exported, axes = "gltf";
  std::size_t influences = 4;
  bool influence_loss = false, keep_going = false, weights = false;
};

/// Does the tasks that need a mesh or a skeleton: influence loss, picture, export.
void use_asset(const std::string& file, const Asset& asset, const InspectOptions& options, Json& description) {
  if (options.influence_loss) {
    if (asset.skin.rows() == 0) throw InputError(file, "", "--influence-loss needs skin weights, and it has none");
    description["influence_loss"] = eval::to_json(eval::influence_loss(asset, options.influences));
  }
  if (!options.picture.empty()) io::write_png(options.picture, eval::asset_picture(asset));
  if (!options.exported.empty()) {
    io::ExportOptions exported;
    exported.influences = options.influences;
    exported.axes = options.axes == "published" ? io::ExportAxes::kPublished : io::ExportAxes::kGltf;
    exported.require_rig = false;
    io::write_gltf(options.exported, asset, exported);
  }
}

eval::InspectedFile inspect_one(const std::string& file, const InspectOptions& options) {
  eval::InspectedFile result{file, {}, ""};
  try {
    const eval::FileKind kind = eval::file_kind(file);
    if (options.weights && kind != eval::FileKind::kRun) {
      throw InputError(file, "", "--weights needs the folder of a run, with config.json and ckpts");
    }
    if (eval::is_geometry(kind)) {
      refuse_to_overwrite({options.picture, options.exported}, [&] {
        const auto sample = eval::sample_of(file);
        return io::files_read_with(sample ? sample->first : std::filesystem::path(file));
      });
      const eval::Geometry geometry = eval::read_geometry(file, kind);
      result.description = eval::describe_geometry(file, geometry);
      use_asset(file, geometry.imported.asset, options, result.description);
    } else {
      if (options.influence_loss || !options.picture.empty() || !options.exported.empty()) {
        throw InputError(
            file, "",
            "--picture, --export and --influence-loss need a file with a mesh or a skeleton, or one sample of "
            "a shard: FILE#ID");
      }
      result.description = eval::inspect(file);
      if (options.weights) result.rejection = torch_half("--weights").describe_weights(file, result.description);
    }
  } catch (...) {
    result.rejection = failure_of_item();
  }
  return result;
}

void run(const InspectOptions& options, bool json) {
  const bool several = options.files.size() > 1;
  if (several && (!options.picture.empty() || !options.exported.empty())) {
    throw InputError("", "", "--picture and --export take a single file");
  }
  std::vector<eval::InspectedFile> results;
  for (const std::string& file : options.files) {
    throw_if_interrupted();
    results.push_back(inspect_one(file, options));
  }
  std::size_t rejected = 0;
  for (const auto& result : results) rejected += !result.rejection.empty();
  if (!several && rejected == 1 && !json && !options.keep_going) throw InputError("", "", results[0].rejection);
  if (json) {
    // Names come from foreign files and need not be UTF-8, which JSON demands.
    std::printf("%s\n", eval::to_json(results).dump(2, ' ', false, Json::error_handler_t::replace).c_str());
  } else if (several || rejected > 0) {
    std::fputs(to_markdown(eval::file_table(results)).c_str(), stdout);
  } else {
    std::fputs(eval::to_text(results[0].description).c_str(), stdout);
  }
  if (rejected > 0 && !options.keep_going) {
    throw InputError("", "", std::to_string(rejected) + " of " + std::to_string(results.size()) + " files rejected");
  }
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Says what is in a file or folder: a rigged asset, a mesh without a rig, a skeleton, a motion (.glb .gltf .fbx\n"
      ".dae .obj .ply .stl .bvh, text and NPZ rigs), a shard of rigs or one sample of it (FILE#ID), a picture, arrays\n"
      "or a checkpoint, a config, a dataset, a run. Several files give a table. Exit status 2 when a file was\n"
      "rejected, unless --keep-going.\n\n"
      "Examples:\n"
      "  anigen-inspect fox.glb --picture fox.png\n"
      "  anigen-inspect models/*.glb --influence-loss --keep-going\n"
      "  anigen-inspect statue.obj walk.bvh photo.jpg\n"
      "  anigen-inspect 'shard.npz#UUID' --export one.glb\n"
      "  anigen-inspect fox.gltf --export fox.glb --influences 8\n"
      "  anigen-inspect runs/skin_ae --json\n"
      "  anigen-inspect ckpts/anigen/* --weights"};
  CommonOptions common;
  InspectOptions options;
  app.add_option("files", options.files, "Files or folders")->required();
  app.add_option("--picture", options.picture, "Draw what the file has (colour, weights, skeleton) to this PNG");
  app.add_option("--export", options.exported, "Write the mesh, its rig or its motion to this .glb or .gltf");
  app.add_option("--influences", options.influences, "Influences per vertex of --export and --influence-loss")
      ->capture_default_str()
      ->check(whole_number(1, 64));
  app.add_option("--axes", options.axes, "Axes of --export: gltf, or published (turned by 180 degrees)")
      ->capture_default_str()
      ->check(CLI::IsMember({"gltf", "published"}));
  app.add_flag("--influence-loss", options.influence_loss, "What keeping only so many influences changes");
  app.add_flag("--weights", options.weights,
               "Of a run or a published folder: do its checkpoints hold what config.json asks for?");
  app.add_flag("--keep-going", options.keep_going, "Exit 0 even when files were rejected");
  add_common_options(app, common, library_versions(),
                     {{"--seed", "draws nothing at random"}, {"--device", "uses the CPU"}});
  return run_command(app, common, argc, argv, [&] {
    if (options.exported.empty()) refuse_given(app, {"--axes"}, "is of the file of --export");
    if (options.exported.empty() && !options.influence_loss)
      refuse_given(app, {"--influences"}, "is of --export and --influence-loss");
    run(options, common.json);
  });
}
