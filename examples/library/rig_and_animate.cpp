// A mesh becomes a rigged GLB that moves; with the true rig as third argument, the distances to it.
//   rig_and_animate MESH OUT.glb [TRUTH.glb]
#include <anigen/anigen.h>
#include <cstdio>
#include <exception>

int main(int argc, char** argv) try {
  using namespace anigen;
  if (argc != 3 && argc != 4) {
    std::fprintf(stderr, "usage: %s MESH OUT.glb [TRUTH.glb]\n", argv[0]);
    return 2;
  }
  Job job([](const std::string& stage, double fraction) {
    std::fprintf(stderr, "%s: %.0f %%\n", stage.c_str(), 100.0 * fraction);
  });
  engine::RigOptions options;
  options.keep_skeleton = false;
  engine::Rigged rigged = engine::rig(engine::load(argv[1]), options, &job);
  std::printf("%zu joints: %s\n", rigged.asset.skeleton.size(), rigged.note.c_str());
  rigged.asset.animations = engine::animate(rigged.asset);
  engine::save(rigged.asset, argv[2]);
  if (argc == 4) {
    const engine::Scores scores = engine::evaluate(rigged.asset, engine::load(argv[3]));
    for (const auto& [metric, value] : scores.values) std::printf("%s %.4f\n", metric.c_str(), value);
  }
} catch (const std::exception& error) {
  std::fprintf(stderr, "error: %s\n", error.what());
  return 1;
}
