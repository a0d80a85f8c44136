#include <cstdio>

#include "anigen/apps/common/command_line.h"
#include "anigen/core/error.h"
#include "anigen/prepare/dataset.h"

int main(int argc, char** argv) {
  using namespace anigen;
  CLI::App app{
      "Turns rigged glTF files and procedural creatures into a dataset on disk.\n"
      "Repeating a command goes on where it stopped: what exists already is not made again.\n\n"
      "Examples:\n"
      "  anigen-prepare --out data/creatures --procedural 400\n"
      "  anigen-prepare --out data/mixed --input models/ more_models/ --procedural 400 --test-fraction 0.333"};
  CommonOptions common;
  prepare::PrepareOptions options;
  std::vector<std::string> inputs;
  std::size_t procedural = 0, test_count = 0;
  bool skip_assets = false;
  app.add_option("--out", options.out, "Folder of the dataset")->required();
  app.add_option("--input", inputs, "Folders (searched for .glb and .gltf) or single files");
  app.add_option("--procedural", procedural, "Number of procedural creatures");
  app.add_option("--test-fraction", options.test_fraction, "Part of the usable real assets kept for testing")
      ->capture_default_str();
  CLI::Option* count = app.add_option("--test-count", test_count, "Number of usable real assets kept for testing");
  count->excludes(app.get_option("--test-fraction"));
  app.add_option("--procedural-test", options.procedural_test, "Number of usable creatures kept for testing")
      ->capture_default_str();
  app.add_option("--min-joints", options.limits.min_joints, "Fewer joints make is_bad_skeleton")->capture_default_str();
  app.add_option("--max-joints", options.limits.max_joints, "More joints make is_bad_skeleton")->capture_default_str();
  app.add_option("--same-bone", options.limits.same_bone,
                 "Bones that differ by no more than this make is_bad_skeleton; 0 compares exactly")
      ->capture_default_str();
  app.add_option("--max-invented-rows", options.limits.max_invented_rows,
                 "A larger part of vertices without weights in the file makes is_bad_skin")
      ->capture_default_str();
  app.add_flag("--no-assets", skip_assets, "Do not keep the assets themselves (assets/<id>.glb)");
  add_common_options(app, common);
  return run_command(app, common, argc, argv, [&] {
    options.seed = common.seed;
    options.keep_assets = !skip_assets;
    if (count->count() > 0) options.test_count = test_count;
    options.sources = prepare::find_assets({inputs.begin(), inputs.end()});
    for (auto& source : prepare::procedural_sources(common.seed, procedural))
      options.sources.push_back(std::move(source));
    const prepare::PrepareSummary summary = prepare::prepare_dataset(options);
    if (common.json) {
      std::printf("%s\n", prepare::to_json(summary).dump(2).c_str());
    } else if (!common.quiet) {
      std::fputs(prepare::to_text(summary).c_str(), stdout);
    }
  });
}
