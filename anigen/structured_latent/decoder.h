#pragma once
#include <functional>
#include <string>
#include <vector>

#include "anigen/nn/init.h"
#include "anigen/nn/state_dict.h"
#include "anigen/nn/trainable.h"
#include "anigen/shape_field/mesh_extraction.h"
#include "anigen/skeleton_field/field.h"
#include "anigen/skeleton_field/voting.h"
#include "anigen/skin_field/skin_autoencoder.h"
#include "anigen/sparse/blocks.h"
#include "anigen/sparse/support.h"
#include "anigen/structured_latent/encoder.h"
#include "anigen/structured_latent/options.h"
#include "anigen/structured_latent/torso.h"

namespace anigen::structured_latent {

/// Two up-sampling blocks that take a stream from R to 4 R (docs/reference/autoencoders.md, 4.6). Registered with the
/// model under one name, keys `<name>.0.*` and `<name>.1.*`.
class StructuredLatentUpsampler {
 public:
  StructuredLatentUpsampler() = default;
  /// @param channels widths before, between and behind
  StructuredLatentUpsampler(torch::nn::Module& model, const char* name, std::int64_t channels, std::int64_t between,
                            std::int64_t behind);
  bool present() const { return !blocks_.empty(); }

  /// @return in the dtype of the blocks @param recompute whether blocks keep only their inputs for the backward pass
  sparse::SparseTensor forward(const sparse::SparseTensor& x, bool recompute);

 private:
  std::vector<sparse::SubdivideBlock> blocks_;
};

/// Channels of the skeleton heads of the decoder: joint 3, parent 3, their confidences 1 and 1, that of the skin
/// feature 1, the skin feature S; each of the fields eight times, corner by corner, when it stands on corners
/// (docs/reference/autoencoders.md, 4.5).
struct SkeletonHeadLayout {
  std::int64_t resolution = 0;  ///< of the voxels of the field
  std::int64_t skin_channels = 0;
  bool joint_confidence = false, skin_confidence = false, on_center = true;
  bool residual = true;    ///< joints and parents relative to the position
  bool continuous = true;  ///< confidences through a sigmoid; the joint's also serves the skin feature

  explicit SkeletonHeadLayout(const StructuredLatentDecoderOptions& options);
  /// Without the skin feature, and of it.
  std::int64_t joint_channels() const;
  std::int64_t skin_feature_channels() const { return skin_channels * (on_center ? 1 : 8); }
};

/// The fields of every asset, activated. On corners, values are first averaged over the voxels that touch a grid
/// vertex, in the order x, y, z of the vertices; a vertex v stands at (v + 0.5)/R − 0.5, as published.
/// @param raw joint_channels() + skin_feature_channels() channels @throws InputError for another number of channels
std::vector<skeleton_field::SkeletonField> skeleton_fields(const sparse::SparseTensor& raw,
                                                           const SkeletonHeadLayout& layout);

/// Decoder of the structured latents into the S³ fields: a mesh field on fine voxels, a skeleton field with confidence,
/// skin features on both (paper 3.3; docs/reference/autoencoders.md, 4.5, 4.6, 4.7 and 4.8). Published keys.
///
/// Precision: fp32 as it is built; half_precision_modules() and convert_to_fp16() as SkinAutoEncoder. Of the
/// off-by-default grouped cross attention the published system also halves two bare parameters and a norm, which stay
/// fp32 here.
class StructuredLatentDecoderImpl : public nn::FreezableModel {
 public:
  /// Parameters named by modules_to_freeze ask for no gradient if the options say so.
  explicit StructuredLatentDecoderImpl(const StructuredLatentDecoderOptions& options,
                                       nn::Init init = nn::Init::kPublished);

  struct Fields {
    sparse::SparseTensor mesh;                             ///< fine voxels, mesh_options().channels() channels, fp32
    sparse::SparseTensor skeleton;                         ///< raw channels of the skeleton heads
    std::vector<skeleton_field::SkeletonField> skeletons;  ///< per asset, activated
    std::vector<skeleton_field::SkeletonTensors> joints;   ///< per asset: grouped, or what the caller gave
    std::vector<skeleton_field::JointSkinFeatures> joint_features;  ///< per asset
    torch::Tensor skin_coarse;  ///< what the up-sampling of the skin starts from, for inspection
  };
  /// @param z geometry and skin channels on the surface voxels @param z_skl on the skeleton voxels
  /// @param given skeletons instead of the grouped ones, one per asset; empty: group the votes
  /// @throws InputError naming what does not fit: batch sizes, channels, voxels outside the grid, values not finite
  Fields forward(const sparse::SparseTensor& z, const sparse::SparseTensor& z_skl,
                 const std::vector<skeleton_field::SkeletonTensors>& given = {});
  /// As above, with geometry and skin apart, on one support: a frozen geometry whose latents carry no gradient then
  /// keeps nothing for the backward pass.
  Fields forward(const PerStream<sparse::SparseTensor>& z,
                 const std::vector<skeleton_field::SkeletonTensors>& given = {});

  /// Fields that rigs come from, before votes are grouped and a surface is made: a fraction of the work of forward().
  struct RigFields {
    std::vector<skeleton_field::SkeletonField> skeletons;  ///< per asset, activated
    sparse::SparseTensor skin;  ///< skin stream on the surface voxels, before joints are looked up and up-sampling
  };
  /// @throws InputError as forward()
  RigFields rig_fields(const PerStream<sparse::SparseTensor>& z);

  /// Meshes of geometry latents alone, one per asset, without skin features: those of forward(), whatever the latents
  /// of skin and skeleton, at less than half of the work.
  /// @param z geometry channels on the surface voxels @throws InputError as forward()
  std::vector<shape_field::ExtractedMesh> decode_shapes(const sparse::SparseTensor& z);

  /// Another way to turn votes into a skeleton than grouping_strategy; an empty function: grouping_strategy again.
  void group_with(std::function<skeleton_field::SkeletonTensors(const skeleton_field::SkeletonField&)> grouping);

  /// Layout of Fields::mesh, for shape_field::extract_mesh.
  const shape_field::MeshFieldOptions& mesh_options() const { return mesh_options_; }
  /// Meshes of each asset. Further parameters see shape_field::extract_mesh.
  std::vector<shape_field::ExtractedMesh> extract_meshes(
      const Fields& decoded, bool training,
      shape_field::SkinFeatures skin_features = shape_field::SkinFeatures::kOfAllVertices);
  /// Skin weights of any points of one asset from their skin features, in chunks of points that take at most
  /// `max_bytes` beside the result, at least one point (docs/reference/autoencoders.md, 2.2 and 5.5). Exact: a point's
  /// weights depend on its own feature and the joints only. With gradients the graph of all chunks is kept.
  /// @param vertex_features [V, F] @param joint_features [J, F] @return [V, J]
  /// @throws InputError for shapes that do not fit, a skeleton without joints, a parent out of range
  torch::Tensor skin_weights(const torch::Tensor& vertex_features, const skeleton_field::SkeletonTensors& skeleton,
                             const torch::Tensor& joint_features, std::int64_t max_bytes = 256 << 20);

  /// Blocks of the torso and of the up-sampling keep only their inputs for the backward pass and run again in it
  /// (nn::recomputed). Default: use_checkpoint.
  void recompute_blocks(bool on);

  const StructuredLatentDecoderOptions& options() const { return options_; }
  skin_field::SkinDecoder& skin_decoder() { return skin_decoder_; }

 private:
  /// Streams behind the torso and the skin's U-Net. @throws InputError as forward()
  PerStream<sparse::SparseTensor> streams_of(const PerStream<sparse::SparseTensor>& z);
  /// Raw channels of the skeleton heads, Fields::skeleton.
  sparse::SparseTensor skeleton_channels(const sparse::SparseTensor& h);
  /// Fills the skeleton part of `decoded` from the torso's skeleton stream.
  void decode_joints(const sparse::SparseTensor& h, const std::vector<skeleton_field::SkeletonTensors>& given,
                     Fields& decoded);
  sparse::SparseTensor decode_surface(const sparse::SparseTensor& geometry, const sparse::SparseTensor& skin);
  /// Channels of the mesh field without skin, at the fine voxels.
  sparse::SparseTensor shape_channels(const sparse::SparseTensor& geometry);

  StructuredLatentDecoderOptions options_;
  shape_field::MeshFieldOptions mesh_options_;
  SkeletonHeadLayout layout_;
  bool recompute_ = false;
  std::function<skeleton_field::SkeletonTensors(const skeleton_field::SkeletonField&)> grouping_;
  StructuredLatentTorso torso_;
  skin_field::SkinDecoder skin_decoder_ = nullptr;
  SkinUnet skin_unet_ = nullptr;
  GroupedCross grouped_cross_;
  StructuredLatentUpsampler upsample_, upsample_skin_, upsample_skeleton_;
  nn::Linear out_layer_ = nullptr, out_layer_skin_ = nullptr, out_layer_skl_skin_ = nullptr, out_layer_skl_ = nullptr;
};
TORCH_MODULE(StructuredLatentDecoder);

/// Class names of the two models of stage 3 in configs.
inline constexpr const char* kStructuredLatentEncoderClass = "AniGenElasticSLatEncoder";
inline constexpr const char* kStructuredLatentDecoderClass = "AniGenElasticSLatMeshDecoder";

/// Bandwidth and least votes that were fitted for a run (generate/grouping.h): {"bandwidth", "least_votes", …}.
inline std::filesystem::path grouping_file(const std::filesystem::path& run) { return run / "grouping.json"; }
/// Choice where a bandwidth or a least number of votes of 0 stands for the fitted one, or the published one where none
/// was fitted. The form stays; load_rig_decoder() knows that of the run. @param run its folder @throws InputError for a
/// damaged file
skeleton_field::MeanShiftOptions grouping_of_run(skeleton_field::MeanShiftOptions asked,
                                                 const std::filesystem::path& run);

/// Variant that the run of a decoder trained, from its config. @param decoder by find_run_model()
StructuredLatentVariant variant_of_run(const nn::RunModel& decoder);
/// Options whose form is that of the variant, where they ask for that of the run.
skeleton_field::MeanShiftOptions in_form_of(skeleton_field::MeanShiftOptions asked,
                                            const StructuredLatentVariant& variant);
/// The decoder as its run's variant decodes whole rigs: votes are grouped with the variant's confidences, in its form.
/// @throws InputError as nn::load_trained(), and for a run that trained the shape alone, whose skeletons and weights
/// mean nothing
/// @param grouping of votes by mean shift, as grouping_of_run(); the published values leave many joints of decoders
/// that trained briefly
StructuredLatentDecoder load_rig_decoder(const nn::RunModel& found, torch::Device device,
                                         const skeleton_field::MeanShiftOptions& grouping = {});

}  // namespace anigen::structured_latent
