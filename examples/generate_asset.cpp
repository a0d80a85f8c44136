// A picture becomes a rigged GLB in a program of one's own.
//   example_generate_asset PICTURE CHECKPOINTS OUT.glb
// CHECKPOINTS is a folder with the runs of both flows: the released ckpts/, or one of runs trained here.
#include <cstdio>
#include <exception>

#include "anigen/generate/assemble.h"
#include "anigen/generate/asset_generator.h"
#include "anigen/generate/finishing.h"
#include "anigen/generate/picture_input.h"
#include "anigen/generate/run_weights.h"
#include "anigen/io/gltf/gltf.h"

int main(int argc, char** argv) try {
  using namespace anigen::generate;
  if (argc != 4) {
    std::fprintf(stderr, "usage: %s PICTURE CHECKPOINTS OUT.glb\n", argv[0]);
    return 2;
  }
  const FlowRuns runs = find_flow_runs(argv[2], /*joint_count=*/false);
  AssetGenerator::Request models;
  models.structure_flow = runs.structure;
  models.latent_flow = runs.latents;
  AssetGenerator generator(models);

  PreprocessingOptions first, second;
  first.size = generator.structure_size();
  second.size = generator.latent_size();
  const auto structure_picture = ImagePreprocessor(first).run(argv[1]).picture_tensor;
  const auto latent_picture = ImagePreprocessor(second).run(argv[1]).picture_tensor;
  const GeneratedAsset made = generator.generate(structure_picture, latent_picture, "asset", GenerationOptions());

  anigen::io::write_gltf(argv[3], finish_asset(made.decoded.asset, FinishingOptions()).asset);
} catch (const std::exception& error) {
  std::fprintf(stderr, "error: %s\n", error.what());
  return 1;
}
