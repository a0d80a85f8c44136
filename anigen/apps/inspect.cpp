#include <cctype>
#include <cstdio>

#include "anigen/apps/common/command_line.h"
#include "anigen/apps/common/torch_half.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/process.h"
#include "anigen/eval/describe.h"
#include "anigen/eval/inspect.h"
#include "anigen/eval/lint_files.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/io/rigs/samples.h"
#include "anigen/io/write_rigged.h"

namespace {

using namespace anigen;

struct InspectOptions {
  std::vector<std::string> files, outputs;
  std::string image, exported, axes = "gltf";  ///< the first two: of the outputs, by extension
  std::size_t influences = 4;
  bool influence_loss = false, weights = false, lint = false;
  std::string lint_level = "error";
};

/// Sorts the outputs by what their extension asks for.
void sort_outputs(InspectOptions& options) {
  for (const std::string& output : options.outputs) {
    std::string extension = std::filesystem::path(output).extension().string();
    for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    if (extension != ".png" && !io::is_rigged_output(output))
      throw InputError(output, "--output",
                       "expected .png for an image of the file; .glb, .gltf, .fbx, .usdz or .usda for its contents");
    std::string& file = extension == ".png" ? options.image : options.exported;
    if (!file.empty()) throw InputError(output, "--output", "one image and one file of its contents at most");
    file = output;
  }
}

/// Does the tasks that need a mesh or a skeleton: influence loss, image, export.
void use_asset(const std::string& file, const Asset& asset, const InspectOptions& options, Json& description) {
  if (options.influence_loss) {
    if (asset.skin.rows() == 0) throw InputError(file, "", "--influence-loss needs skin weights, and it has none");
    description["influence_loss"] = eval::to_json(eval::influence_loss(asset, options.influences));
  }
  if (!options.image.empty()) io::write_png(options.image, eval::asset_picture(asset));
  if (!options.exported.empty()) {
    io::ExportOptions exported;
    exported.influences = options.influences;
    exported.axes = options.axes == "published" ? io::ExportAxes::kPublished : io::ExportAxes::kGltf;
    exported.require_rig = false;
    io::write_rigged(options.exported, asset, exported);
  }
}

eval::InspectedFile inspect_one(const std::string& file, const InspectOptions& options) {
  eval::InspectedFile result{file, {}, ""};
  try {
    const eval::FileKind kind = eval::file_kind(file);
    if (options.weights && kind != eval::FileKind::kRun)
      throw InputError(file, "", "--weights needs the folder of a run, with config.json and ckpts");
    if (eval::is_geometry(kind)) {
      refuse_to_overwrite({options.image, options.exported}, [&] {
        const auto sample = io::sample_of(file);
        return io::files_read_with(sample ? sample->first : std::filesystem::path(file));
      });
      const eval::Geometry geometry = eval::read_geometry(file, kind);
      result.description = eval::describe_geometry(file, geometry);
      use_asset(file, geometry.imported.asset, options, result.description);
    } else {
      if (options.influence_loss || !options.image.empty() || !options.exported.empty()) {
        throw InputError(
            file, "",
            "--output and --influence-loss need a file with a mesh or a skeleton, or one sample of a shard: FILE#ID");
      }
      result.description = eval::inspect(file);
      if (options.weights) result.rejection = torch_half("--weights").describe_weights(file, result.description);
    }
  } catch (...) {
    result.rejection = failure_of_item();
  }
  return result;
}

void run(const InspectOptions& options, const CommonOptions& common) {
  const bool several = options.files.size() > 1;
  if (several && !options.outputs.empty()) throw InputError("", "--output", "takes a single file");
  std::vector<eval::InspectedFile> results;
  for (const std::string& file : options.files) {
    throw_if_interrupted();
    results.push_back(inspect_one(file, options));
  }
  std::size_t rejected = 0;
  for (const auto& result : results) rejected += !result.rejection.empty();
  if (common.json) {
    // Names come from foreign files and need not be UTF-8, which JSON demands.
    std::printf("%s\n", eval::to_json(results).dump(2, ' ', false, Json::error_handler_t::replace).c_str());
  } else if (several) {
    std::fputs(to_markdown(eval::file_table(results)).c_str(), stdout);
  } else if (rejected == 0) {
    std::fputs(eval::to_text(results[0].description).c_str(), stdout);
  }
  if (!several && rejected > 0) throw InputError("", "", results[0].rejection);
  require_inputs(rejected, results.size(), "files rejected", common);
}

/// Lints all rigs of the files. @throws Error where one has findings of the level
void run_lint(const InspectOptions& options, const CommonOptions& common) {
  const lint::Severity level = lint::parse_severity(options.lint_level);
  std::vector<eval::LintedFile> results;
  for (const std::string& file : options.files) {
    try {
      for (eval::LintedFile& result : eval::lint_path(file)) results.push_back(std::move(result));
    } catch (...) {
      results.push_back({file, {}, failure_of_item()});
    }
  }
  std::size_t rejected = 0, failed = 0;
  for (const eval::LintedFile& result : results) {
    rejected += !result.rejection.empty();
    failed += result.lint.count(level) > 0;
  }
  const bool several = results.size() > 1;
  if (common.json) {
    std::printf("%s\n", eval::to_json(results).dump(2, ' ', false, Json::error_handler_t::replace).c_str());
  } else if (several || rejected == 0) {
    for (const eval::LintedFile& result : results) std::fputs(eval::to_text(result).c_str(), stdout);
  }
  if (!several && rejected > 0) throw InputError("", "", results[0].rejection);
  if (failed > 0) {
    throw Error(std::to_string(failed) + " of " + std::to_string(results.size()) + " rigs have findings of level " +
                options.lint_level + (level == lint::Severity::kError ? "" : " or above"));
  }
  require_inputs(rejected, results.size(), "files rejected", common);
}

}  // namespace

int main(int argc, char** argv) {
  Program program(
      "anigen-inspect",
      "Says what is in a file or folder: a rigged asset, a mesh without a rig, a skeleton, a motion (.glb .gltf .fbx\n"
      ".dae .obj .ply .stl .3mf .bvh, text and NPZ rigs), a shard of rigs or one sample of it (FILE#ID), an image, "
      "arrays\n"
      "or a checkpoint, a config, a dataset, a run. Several files give a table.",
      "  anigen-inspect fox.glb -o fox.png\n"
      "  anigen-inspect models/*.glb --influence-loss --keep-going\n"
      "  anigen-inspect models/ --lint --lint-level warning\n"
      "  anigen-inspect statue.obj walk.bvh photo.jpg\n"
      "  anigen-inspect 'shard.npz#UUID' -o one.glb\n"
      "  anigen-inspect fox.gltf -o fox.glb --influences 8\n"
      "  anigen-inspect fox.glb -o fox.fbx\n"
      "  anigen-inspect runs/skin_ae --json\n"
      "  anigen-inspect ckpts/anigen/* --weights");
  CLI::App& app = program.app;
  InspectOptions options;
  add_option(app, "files", options.files)->required();
  add_option(app, "--output", options.outputs,
             ": .png draws what the file has (colour, weights, skeleton); .glb, .gltf, .fbx, .usdz and .usda hold its "
             "mesh, rig and motion; repeatable");
  add_option(app, "--influences", options.influences)->check(whole_number(1, 64));
  add_option(app, "--axes", options.axes);
  add_option(app, "--influence-loss", options.influence_loss);
  add_option(app, "--weights", options.weights);
  add_option(app, "--lint", options.lint);
  add_option(app, "--lint-level", options.lint_level);
  program.add_common({"--keep-going", "--threads", "--json"}, library_versions());
  return program.run(argc, argv, [&] {
    if (options.lint) {
      refuse_given(app, {"--output", "--influences", "--axes", "--influence-loss", "--weights"},
                   "does not go with --lint");
      run_lint(options, program.common);
      return;
    }
    refuse_given(app, {"--lint-level"}, "applies only with --lint");
    sort_outputs(options);
    if (options.exported.empty()) refuse_given(app, {"--axes"}, "applies only to the contents in --output");
    if (options.exported.empty() && !options.influence_loss)
      refuse_given(app, {"--influences"}, "applies only to the contents in --output, and to --influence-loss");
    run(options, program.common);
  });
}
