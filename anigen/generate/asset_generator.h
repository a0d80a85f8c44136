#pragma once
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "anigen/generate/picture_input.h"
#include "anigen/generate/stage_generators.h"
#include "anigen/skeleton_field/voting.h"

namespace anigen::generate {

/// Sampling options of one flow; what is not set is as its config samples.
struct SamplerOverrides {
  std::optional<std::int64_t> steps;
  std::optional<flow::Solver> solver;
  std::optional<double> cfg_strength;  ///< the extra weight: 7.5 is a guidance scale of 8.5; 0: no guidance
  std::optional<std::pair<double, double>> cfg_interval;
  std::optional<std::int64_t> cfg_every;
  std::optional<double> velocity_tolerance;
  std::optional<std::int64_t> windowed_steps;

  flow::SamplerOptions over(flow::SamplerOptions options) const;
};

/// Kind of image that conditions the first flow: what its config trained on, which a published config does not say and
/// the published pipeline fixes to normals (docs/reference/flows.md, 5.1), or one of the two.
enum class StructureCondition { kAsTrained, kColor, kNormal };

struct GenerationOptions {
  std::uint64_t seed = 42;
  SamplerOverrides structure, latents;
  flow::ViewRule views = flow::ViewRule::kAverage;  ///< of several images of one object
  std::int64_t joints = 0;  ///< wanted number of joints, for flows that were told it in training; 0: as many as fit
  /// Instead of what the first flow would give: bool [R, R, R] each, R = AssetGenerator::grid().
  std::optional<sparse_structure::VoxelPair> given_voxels;
  /// Instead of what both flows would give: a batch of one, not normalised, on voxels of their own.
  std::optional<structured_latent::PerStream<sparse::SparseTensor>> given_latents;
  bool voxels_alone = false;  ///< generate() ends after the first flow: nothing is decoded and there are no latents
  /// Called before the second flow begins.
  std::function<void(const sparse_structure::VoxelPair&)> voxels_found = nullptr;
};

/// Times of one generation, seconds.
struct GenerationTimes {
  double condition = 0, structure = 0, latents = 0, decode = 0;
};

struct GeneratedAsset {
  RigDecoder::Decoded decoded;  ///< dense mesh with vertex colours, skeleton, skin; the votes
  flow::Streams structure;      ///< what the first flow gave, shape and skeleton, denormalised: [1, C, r, r, r] each
  sparse_structure::VoxelPair voxels;                          ///< the same, decoded, or those given
  structured_latent::PerStream<sparse::SparseTensor> latents;  ///< what the second flow gave
  std::int64_t shape_voxels = 0, skeleton_voxels = 0;
  std::optional<torch::Tensor> cameras;  ///< [V, 7] of the latent pictures, where their encoder estimates them
  GenerationTimes times;
};

/// The noise of one asset: the draws of the published program for a seed on a CPU (docs/reference/flows.md, 5.4), as
/// long as LibTorch draws them so.
at::Generator noise_generator(std::uint64_t seed);

/// The published joint density levels 0 … 4 as numbers of joints: 0 (none asked), 10, 15, 25, 35
/// (docs/reference/flows.md, 5.5). @throws InputError for another level
std::int64_t joints_of_level(int level);

/// As structured_latent::grouping_of_run(), with the values that were fitted for the second flow before those of its
/// auto-encoder: latents that a flow makes vote less exactly than encoded ones.
/// @param flow, autoencoder run folders of stages 5 and 3 @throws InputError for a damaged file
skeleton_field::MeanShiftOptions grouping_of_flow(const skeleton_field::MeanShiftOptions& asked,
                                                  const std::filesystem::path& flow,
                                                  const std::filesystem::path& autoencoder);

/// The whole way from pictures to a rigged asset: sparse structure, structured latents, decoding (paper 3.4;
/// docs/reference/flows.md, 5.1). Preprocessing is in picture_input.h, what follows in finishing.h.
///
/// Noise comes from one generator of the seed in the published order: shape and skeleton of the structure, then both
/// streams of the latents; so the same seed gives the same asset whatever else is generated, and the noise of the
/// published program. Given voxels leave the noise of the latents as it is, so that the voxels of the first flow,
/// given, end in the asset of the whole way.
class AssetGenerator {
 public:
  struct Request {
    std::filesystem::path structure_flow;                             ///< run folder of stage 4, or a published one
    std::filesystem::path latent_flow;                                ///< run folder of stage 5, or a published one
    std::filesystem::path structure_autoencoder, latent_autoencoder;  ///< empty: the runs that the flows' configs name
    nn::Averages averages = nn::Averages::kUsual;
    std::string device = "cpu";
    torch::Dtype precision = torch::kFloat32;   ///< of the flows, one of nn::kFlowPrecisions
    bool low_memory = false;                    ///< one model at a time: each is read again for every picture
    skeleton_field::MeanShiftOptions grouping;  ///< of the votes, as grouping_of_flow()
    StructureCondition structure_condition = StructureCondition::kAsTrained;
  };
  /// Reads the configs, and the weights too unless memory is low. @throws InputError when a run is unusable
  explicit AssetGenerator(const Request& request);

  int structure_size() const { return structure_size_; }  ///< pixels of the picture that the first flow sees
  int latent_size() const { return latent_size_; }
  /// The flows make the shape alone (`geometry_only`): an asset is a mesh that one joint holds, without votes.
  bool shape_alone() const { return shape_alone_; }
  bool structure_sees_normals() const { return structure_sees_normals_; }
  /// The run folders that are used: both flows, both auto-encoders, then picture estimators of their image encoders.
  const std::vector<std::filesystem::path>& runs() const { return runs_; }
  std::int64_t grid() const { return grid_; }  ///< voxels along a side

  /// The auto-encoders whose decoders are used, with their encoders. @throws InputError as their constructors
  StructureCoder structure_coder() const;
  StructuredLatentCoder latent_coder() const;  ///< without its decoder: generate() decodes given latents

  /// Occupied voxels that the first flow gives: those of generate() for the same pictures and options.
  sparse_structure::VoxelPair sample_voxels(const torch::Tensor& structure_pictures, const std::string& name,
                                            const GenerationOptions& options);
  /// @param structure_pictures [V, 3, S, S] in [0, 1], S = structure_size(), colours or normals: one image of the
  /// object, or several, by which the flows go together (GenerationOptions::views)
  /// @param latent_pictures likewise for the second flow, colours, of the same views
  /// @throws InputError when joints are asked of a flow that knows nothing of them, without a picture, when the two
  /// flows are given different numbers of views, and as flow::under_views(); Error when the first flow gives no voxels,
  /// or the decoder no surface or joint
  GeneratedAsset generate(const torch::Tensor& structure_pictures, const torch::Tensor& latent_pictures,
                          const std::string& name, const GenerationOptions& options);

 private:
  FlowRequest flow_request(const std::filesystem::path& run) const;
  void sample_structure(const torch::Tensor& pictures, const std::string& name, const GenerationOptions& options,
                        const at::Generator& generator, GeneratedAsset& made);
  void sample_latents(const torch::Tensor& pictures, const std::string& name, const GenerationOptions& options,
                      const at::Generator& generator, GeneratedAsset& made);
  StructureGenerator& structure();
  StructuredLatentGenerator& latents();
  RigDecoder& decoder();
  void forget_unless_kept();
  /// @throws InputError when a run's voxels are not those of the second flow
  void require_grid(std::int64_t found, const std::filesystem::path& run) const;

  Request request_;
  std::unique_ptr<StructureGenerator> structure_;
  std::unique_ptr<StructuredLatentGenerator> latents_;
  std::unique_ptr<RigDecoder> decoder_;
  std::filesystem::path latent_autoencoder_;
  std::vector<std::filesystem::path> runs_;
  std::string structure_decoder_ckpt_, latent_decoder_ckpt_;
  int structure_size_ = 0, latent_size_ = 0;
  bool structure_sees_normals_ = false, counts_joints_ = false, shape_alone_ = false;
  std::int64_t grid_ = 0;
};

}  // namespace anigen::generate
