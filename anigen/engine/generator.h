#pragma once
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/job.h"

namespace anigen::engine {

/// Models of a generator, as those of anigen-generate.
struct GeneratorOptions {
  /// Run folders of both flows; empty: those of `runs`, which must be named where one of the two is. Published
  /// checkpoints count.
  std::filesystem::path structure_flow, latent_flow;
  std::filesystem::path runs;  ///< folder of both flows; empty: the weights that come with the programs
  /// Of several second flows in `runs` take the one that was told numbers of joints, for GenerateOptions::joints.
  bool counts_joints = false;
  std::string device = "cpu";
  std::string precision = "fp32";   ///< fp32, bf16 or int8
  bool low_memory = false;          ///< one model at a time
  std::string background = "auto";  ///< of images: auto, keep, alpha, grabcut, network
  bool image_colors = true;         ///< colours of the image where it shows the asset
};

struct GenerateOptions {
  std::uint64_t seed = 42;
  std::optional<int> structure_steps, latent_steps;           ///< of the samplers; unset: as the configs say
  std::optional<double> structure_guidance, latent_guidance;  ///< guidance scale, 1: none; unset: as the configs say
  int joints = 0;  ///< wanted number, for flows that were told it in training; 0: as many as fit
  /// Encoded image of the image's size, once that is upright by EXIF: the object is where its grey, times its alpha, is
  /// above half. Empty: the background is removed as GeneratorOptions say.
  std::string mask;
  std::string stop_at;  ///< "voxels": ends after the first flow, with Generated::voxels and no asset; empty: whole
  std::string voxels;   ///< Generated::voxels of an earlier call: the first flow does not run again; empty: it does
  /// Pictures (PNG) as they come: "mask", of the image's size, "normals", where the first flow sees them, "voxels" of
  /// mesh and skeleton, "votes" for joints by confidence. From the thread that generates; what it throws ends the call.
  std::function<void(const std::string& name, const std::string& png)> pictures;
};

struct Generated {
  Asset asset;                            ///< the unit cube's frame, Z up, facing −y
  std::vector<std::string> notices;       ///< what was done to image and mesh, a sentence each
  std::map<std::string, double> seconds;  ///< condition, structure, latents, decode
  std::string voxels;                     ///< of the first flow, for GenerateOptions::voxels: NPZ; set in every call
};

class GeneratorWork;

/// Image to rigged asset, with models that are loaded once and kept. One generation at a time: further calls wait.
/// Needs the module anigen-torch and LibTorch, which the first one loads.
class Generator {
 public:
  /// @throws InputError when weights are missing or unusable; NotSupportedError in a build without LibTorch
  explicit Generator(const GeneratorOptions& options = {}, Job* job = nullptr);
  ~Generator();
  Generator(Generator&&) noexcept;
  Generator& operator=(Generator&&) noexcept;

  /// The asset that anigen-generate writes for the image and the seed. Voxels of an earlier call with equal options
  /// give the asset of the whole call, bit for bit. @throws InputError for an unusable image, mask or voxels; Error
  /// when the flows give nothing for this seed; Interrupted
  Generated generate(const std::filesystem::path& image, const GenerateOptions& options = {}, Job* job = nullptr);
  /// Likewise of an encoded image in memory: PNG, JPEG, WebP, BMP or TIFF.
  Generated generate_bytes(const std::string& image, const GenerateOptions& options = {}, Job* job = nullptr);

 private:
  std::unique_ptr<GeneratorWork> work_;
};

}  // namespace anigen::engine
