#pragma once
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/log.h"
#include "anigen/data/datasets.h"
#include "anigen/data/latent_files.h"
#include "anigen/data/metadata.h"
#include "anigen/flow/several_views.h"
#include "anigen/generate/run_weights.h"
#include "anigen/nn/profile.h"
#include "anigen/nn/state_dict.h"
#include "anigen/nn/trainable.h"
#include "anigen/skeleton_field/field.h"
#include "anigen/skeleton_field/voting.h"
#include "anigen/sparse_structure/autoencoder.h"
#include "anigen/sparse_structure/flow.h"
#include "anigen/sparse_structure/voxel_metrics.h"
#include "anigen/sparse_structure/voxel_picture.h"
#include "anigen/structured_latent/decoder.h"
#include "anigen/structured_latent/options.h"
#include "anigen/structured_latent/sampling.h"
#include "anigen/vision/condition.h"

namespace anigen::generate {

/// Writes a latent of one asset as datasets hold it, whole or not at all, to ss_latents/<model>/<id>.npz: mean and
/// mean_skl.
/// @param shape, skeleton [C, r, r, r] @param maker the model's file @throws InputError naming it unless all is finite
void write_structure_latents(const std::filesystem::path& file, const torch::Tensor& shape,
                             const torch::Tensor& skeleton, const std::filesystem::path& maker);

/// Writes a structured latent of one asset to latents/<model>/<id>.npz: coords u8 [N, 3] and feats f32 [N, C of
/// geometry and skin], the same with _skl; ours, with a view, `view` i64 [1]. Of a batch of one.
void write_structured_latents(const std::filesystem::path& file,
                              const structured_latent::PerStream<sparse::SparseTensor>& latents,
                              const std::filesystem::path& maker, std::optional<std::size_t> view = std::nullopt);

/// Axis of a grid [x, y, z] from right to left of an object that faces −Y.
inline constexpr std::int64_t kGridAcross = 0;

/// Voxels of one asset, x, y, z ascending. @param occupied bool [R, R, R] on the CPU
sparse::SupportPtr support_of(const torch::Tensor& occupied);

/// Reconstruction error of decoded latents, the skeleton as dilated as it was encoded.
struct StructureReconstruction {
  sparse_structure::VoxelAgreement shape, skeleton;
};

/// A trained sparse-structure auto-encoder at work on one asset at a time, whose voxels it sees as in its training
/// (resolution and dilation of its run's config).
class StructureCoder {
 public:
  /// @param run folder of stage 2 @param ckpt as nn::find_run_model @param decodes also load the decoder
  /// @throws InputError when the run is unusable; NotSupportedError for encoders of global tokens
  StructureCoder(const std::filesystem::path& run, const std::string& ckpt, torch::Device device, bool decodes);

  const std::filesystem::path& checkpoint() const { return found_.checkpoint; }
  /// Inputs of a latent besides its voxels.
  std::string fingerprint() const;

  /// The very tensors that training saw, a batch of one. @throws InputError when the asset cannot be read
  data::SparseStructureBatch voxels(const data::AssetId& asset) const;
  /// Writes `mean` and `mean_skl`, without noise. @throws InputError unless finite; Error when the disk refuses
  void encode(const data::SparseStructureBatch& voxels, const std::filesystem::path& file);
  /// Voxels that the asset's own latent decodes to. @pre the decoder was loaded
  sparse_structure::VoxelPair reconstruct(const data::SparseStructureBatch& voxels);
  /// @pre the decoder was loaded
  StructureReconstruction agreement(const data::StructureLatent& latent, const data::SparseStructureBatch& voxels);

 private:
  sparse_structure::VoxelPair decode(const torch::Tensor& mean, const torch::Tensor& mean_skl);

  torch::Device device_;
  nn::RunModel found_;
  data::SparseStructureOptions options_;
  sparse_structure::SparseStructureEncoder encoder_;
  sparse_structure::SparseStructureDecoder decoder_ = nullptr;
};

/// Run folder of a trained flow, its device and precision.
struct FlowRequest {
  std::filesystem::path run;  ///< run folder of a flow, ours or a published one
  std::string ckpt;           ///< as nn::find_flow_model
  nn::Averages averages = nn::Averages::kUsual;
  std::string device = "cpu";
  torch::Dtype precision = torch::kFloat32;  ///< of the flow's torso, one of nn::kFlowPrecisions
  bool pictures = true;                      ///< the flow was trained with them; false: it must be one without
};

/// A trained flow with its image encoder, if it has one.
/// @tparam Model its module's holder @tparam Reading options of its dataset @tparam Training options of its trainer
template <typename Model, typename Reading, typename Training>
class FlowGenerator {
 public:
  const nn::RunModel& flow() const { return flow_; }
  const auto& options() const { return model_->options(); }
  /// Of its dataset: the size and kind of its pictures, what normalises its latents, and the decoder's run.
  const Reading& reading() const { return reading_; }
  const flow::SamplerOptions& sampler() const { return training_.sampler; }  ///< as its config samples

  /// @param pictures [B, 3, S, S] in [0, 1], S = reading().image_size; anything for a flow without pictures
  /// @return [B, M, C], of a flow without pictures the one token of zeros that it trained with, [1, 1, C]
  /// @throws InputError at the first call, when the image encoder or its weights are missing or do not fit
  torch::Tensor condition(const torch::Tensor& pictures) {
    const torch::NoGradGuard no_grad;
    if (!reading_.image_conditioned)
      return torch::zeros({1, 1, model_->options().cond_channels}, torch::TensorOptions().device(device_));
    return encoder().tokens(pictures);
  }
  /// Cameras of the pictures, [B, 7], where the image encoder estimates them. @throws InputError as condition()
  std::optional<torch::Tensor> cameras(const torch::Tensor& pictures) {
    const torch::NoGradGuard no_grad;
    return encoder().cameras(pictures);
  }

 protected:
  /// @param classes of the model @param dataset, plain names of the classes of datasets with and without pictures
  /// @throws InputError when the run is unusable, or the flow was trained otherwise than `request.pictures` says
  FlowGenerator(const FlowRequest& request, const std::vector<std::string>& classes, const std::string& dataset,
                const std::string& plain)
      : device_(nn::parse_device(request.device)),
        run_(request.run),
        flow_(nn::find_flow_model(request.run, classes, request.ckpt, request.averages)) {
    ConfigReader top(flow_.run, flow_.config.string());
    ConfigReader reader = top.object("dataset"), args = reader.object("args");
    reader.require("name");
    if (reader.text("name", "") != (request.pictures ? dataset : plain)) {
      throw reader.error("name", request.pictures ? "this flow was trained without pictures; they come from " + dataset
                                                  : "this flow was trained with pictures; without, from " + plain);
    }
    reading_ = Reading::read(args, request.pictures);
    ConfigReader trainer_args = top.object("trainer").object("args");
    training_ = Training::read(trainer_args);
    model_ = nn::model_without_weights<Model>(flow_);
    const bool converts = request.precision != torch::kFloat32, on_cpu = device_.is_cpu();
    // On a CPU each weight as soon as it is read: published flows take gigabytes in fp32.
    nn::load_trained_weights(*model_, flow_, device_,
                             converts && on_cpu ? model_->conversion(request.precision) : nn::LoadedKey());
    if (converts && !on_cpu) model_->set_compute_dtype(request.precision);
    if (converts) release_freed_memory();
  }

  torch::Device device_;
  std::filesystem::path run_;
  nn::RunModel flow_;
  Reading reading_;
  Training training_;
  Model model_ = nullptr;

 private:
  vision::ConditionEncoder& encoder() {
    if (!encoder_) {
      encoder_ =
          vision::trained_condition_encoder(run_, flow_, reading_.image_size, model_->options().cond_channels, device_);
    }
    return *encoder_;
  }

  std::unique_ptr<vision::ConditionEncoder> encoder_;  // from the first condition() on
};

/// A trained sparse-structure flow with the decoder of its latents: pictures become voxels of a shape and its skeleton
/// (paper 3.4; docs/reference/flows.md, 4).
class StructureGenerator : public FlowGenerator<sparse_structure::SparseStructureFlow, data::StructureLatentOptions,
                                                sparse_structure::SparseStructureFlowStageOptions> {
 public:
  struct Request : FlowRequest {
    std::filesystem::path autoencoder;  ///< run folder of stage 2; empty: the one its dataset's ss_dec_path names
  };
  explicit StructureGenerator(const Request& request);

  const std::filesystem::path& autoencoder() const { return autoencoder_; }
  /// Of the weights that its answers depend on, and of its config. @throws Error for a file that is gone
  std::string fingerprint() const;
  bool shape_alone() const { return options().geometry_only; }  ///< decode() then finds no skeleton
  /// True where it trained on given shapes alone: it then finds the skeleton of a shape.
  bool finds_skeletons() const { return training_.p_given_shape == 1.0; }
  /// Latent of a shape's voxels by the auto-encoder, as the dataset normalises it. @param voxels bool [R, R, R]
  /// @return [1, C, r, r, r] @throws InputError when the auto-encoder's run has no encoder, or the flow knows another
  /// grid
  torch::Tensor shape_latent(const torch::Tensor& voxels);
  struct FoundSkeleton {
    torch::Tensor voxels;    ///< bool [R, R, R], one connected component; none true where the flow finds nothing
    double agreement = 0.0;  ///< IoU of the voxels of the shape and of its mirror image, mirrored back
  };
  /// Voxels of the skeleton of a shape, by a flow that finds_skeletons(). The shape is seen twice, as it is and in the
  /// mirror x = 0: logits are the mean of both, mirrored back. @param voxels bool [R, R, R] of the shape
  /// @param noise as noise() gives it, for both
  FoundSkeleton skeleton_of(const torch::Tensor& voxels, const flow::Streams& noise);
  /// Standard normal numbers of a latent, from the seed and the number of an asset, whatever else is sampled with it.
  flow::Streams noise(std::uint64_t seed, std::uint64_t number) const;
  /// Noise as the generator gives it, shape first (docs/reference/flows.md, 5.4).
  flow::Streams noise(const at::Generator& generator) const;
  /// Latents, as the dataset normalises them. @param noise of a batch; the first stream of a flow that trained on given
  /// shapes (finds_skeletons()) is instead the latent of the shape, as shape_latent() has it
  /// @param condition [B or 1, M, C]; for a batch of one also [V, M, C], views of one object that share the velocity by
  /// `rule` @throws InputError as flow::under_views()
  flow::Streams sample(const flow::Streams& noise, const torch::Tensor& condition, const flow::SamplerOptions& sampler,
                       bool guided, const flow::SamplingExtras& extras = {},
                       flow::ViewRule rule = flow::ViewRule::kAverage);
  /// Latents of sample() as latent files hold them: what normalised it in training is undone.
  flow::Streams denormalised(const flow::Streams& latents) const;
  /// Both grids of one item before anything is decided, [1, 1, R, R, R]. @param latents as decode()
  sparse_structure::SparseStructureDecoderImpl::Logits logits(const flow::Streams& latents, std::int64_t item);
  /// Occupied voxels of every item, logit > 0, of the skeleton only the largest component (docs/reference/flows.md,
  /// 5.4). @param latents as sample() returns them, or as the dataset holds them
  std::vector<sparse_structure::VoxelPair> decode(const flow::Streams& latents);

 private:
  std::filesystem::path autoencoder_;
  sparse_structure::SparseStructureEncoder encoder_ = nullptr;  ///< from the first shape_latent() on
  sparse_structure::SparseStructureDecoder decoder_ = nullptr;
};

/// The decoder of stage 3 at work on one asset at a time: structured latents become a rigged asset (paper 3.3;
/// docs/reference/autoencoders.md, 4.5, 4.6, 4.7 and 4.8), grouped as its run's variant groups.
class RigDecoder {
 public:
  /// Extent of what is decoded: with kShapes meshes alone, held by one joint, from the geometry's latents.
  enum class Decodes { kRigs, kShapes };

  /// @param grouping of votes by mean shift
  /// @throws InputError when arguments or weights do not fit, or rigs are asked of a run that trained the shape alone
  RigDecoder(const nn::RunModel& found, torch::Device device, const skeleton_field::MeanShiftOptions& grouping,
             Decodes decodes = Decodes::kRigs);

  const structured_latent::StructuredLatentDecoderOptions& options() const { return decoder_->options(); }

  struct Decoded {
    Asset asset;
    skeleton_field::SkeletonField
        votes;  ///< of the skeleton voxels, with the confidence that grouping took; kShapes: none
  };
  /// @param latents a batch of one, as the encoder writes them: not normalised
  /// @param given skeleton to decode weights for instead of the grouped one; may be null
  /// @throws InputError when there is no surface or no joint
  Decoded decode(const structured_latent::PerStream<sparse::SparseTensor>& latents,
                 const skeleton_field::SkeletonTensors* given, const std::string& name);
  /// Votes alone, as Decoded::votes. @param latents as decode()
  skeleton_field::SkeletonField votes(const structured_latent::PerStream<sparse::SparseTensor>& latents);
  /// Joints and parents that votes are grouped to.
  skeleton_field::SkeletonTensors grouped(const skeleton_field::SkeletonField& votes) const;
  skeleton_field::MeanShiftForm grouping_form() const { return grouping_.form; }

 private:
  Decodes decodes_;
  structured_latent::StructuredLatentVariant variant_;
  skeleton_field::MeanShiftOptions grouping_;
  structured_latent::StructuredLatentDecoder decoder_ = nullptr;
};

/// A trained structured-latent auto-encoder at work on one asset at a time, which it sees as in its training (features,
/// dilation and surface lookup of its run's config), in whatever variant was trained.
class StructuredLatentCoder {
 public:
  /// @param run folder of stage 3 @param ckpt as nn::find_run_model @param decodes also load
  /// the decoder, which groups votes so
  /// @throws InputError when the run is unusable
  StructuredLatentCoder(const std::filesystem::path& run, const std::string& ckpt, torch::Device device,
                        const std::optional<skeleton_field::MeanShiftOptions>& decodes);

  const std::filesystem::path& checkpoint() const { return found_.checkpoint; }
  /// Inputs of a latent besides the asset's files.
  std::string fingerprint() const;
  /// Folder of the features below features/.
  const std::string& feature_model() const { return data_.model; }
  std::int64_t resolution() const { return data_.resolution; }  ///< edge of its grid
  std::int64_t geometry_channels() const { return encoder_->options().latent_channels; }

  /// Files that an asset's latent is made from: features, skeleton voxels, rig.
  std::vector<std::filesystem::path> files(const data::AssetId& asset) const;

  struct Inputs {
    sparse::SparseTensor x, x_skl;
    structured_latent::RiggedMeshes rigs;
  };
  /// A batch of one. @throws InputError when the asset cannot be read
  Inputs inputs(const data::AssetId& asset) const;
  /// The asset's rig, and its surface features at other voxels than its own. On a coarse grid a voxel stands for those
  /// of its stored ones that the surface meets, as datasets pool them; where it meets none, for as many of the nearest
  /// as one side has.
  /// @param voxels bool [R, R, R] each, R of the run @throws InputError also as require_features_anywhere()
  Inputs inputs_at(const data::AssetId& asset, const sparse_structure::VoxelPair& voxels) const;
  /// The asset's rig and features, and other voxels of its skeleton than its own. @param skeleton bool [R, R, R], R of
  /// the run, some of it true @throws InputError when it has another size or the asset cannot be read
  Inputs inputs_with_skeleton(const data::AssetId& asset, const torch::Tensor& skeleton) const;
  /// @throws NotSupportedError naming it, when the run has other features than `surface` or the asset's mesh is missing
  void require_features_anywhere(const data::AssetId& asset) const;

  /// Posterior means of the geometry, normalised latents of skin and skeleton: no noise.
  structured_latent::PerStream<sparse::SparseTensor> encode(const Inputs& inputs);
  /// Writes coords, feats, coords_skl and feats_skl (docs/reference/training.md, 1.1), ours also the `view` that the
  /// voxels were seen in.
  /// @throws InputError when a latent is not finite; Error when the disk refuses
  void write(const structured_latent::PerStream<sparse::SparseTensor>& latents, const std::filesystem::path& file,
             std::optional<std::size_t> view = std::nullopt) const;

  skeleton_field::MeanShiftForm grouping_form() const { return variant_.grouping; }  ///< of the run's config
  /// True where the run trained the shape alone: what it decodes is held by one joint.
  bool shape_alone() const { return variant_.geometry_only; }
  /// Back to an asset: rigged, or the shape of a run that trained nothing else, then without votes.
  /// @pre the decoder was loaded
  /// @param own skeleton of the asset @param use_own instead of the grouped one
  /// @throws as RigDecoder::decode
  RigDecoder::Decoded decode(const structured_latent::PerStream<sparse::SparseTensor>& latents,
                             const skeleton_field::SkeletonTensors& own, bool use_own, const std::string& name);

 private:
  torch::Device device_;
  nn::RunModel found_;
  data::FeatureSkeletonOptions data_;
  structured_latent::StructuredLatentVariant variant_;
  structured_latent::StructuredLatentEncoder encoder_ = nullptr;
  std::optional<RigDecoder> decoder_;
};

/// A trained structured-latent flow: pictures and the voxels of a shape and its skeleton become structured latents
/// (paper 3.4; docs/reference/flows.md, 5.5).
class StructuredLatentGenerator
    : public FlowGenerator<structured_latent::StructuredLatentFlow, data::StructuredLatentOptions,
                           structured_latent::StructuredLatentFlowStageOptions> {
 public:
  explicit StructuredLatentGenerator(const FlowRequest& request);

  /// Standard normal noise of both streams as the generator gives it, shape first, smoothed where the config says so.
  flow::Streams noise(const sparse::Support& shape, const sparse::Support& skeleton,
                      const at::Generator& generator) const;
  /// Latents as the decoder takes them: what normalised them in training is undone.
  /// @param target voxels, tokens and joint counts; for a batch of one the tokens may be [V, K, C], views of one object
  /// that share the velocity by `rule` @throws InputError as flow::under_views()
  structured_latent::PerStream<sparse::SparseTensor> sample(const flow::Streams& noise,
                                                            const structured_latent::StructuredLatentTarget& target,
                                                            const flow::SamplerOptions& sampler, bool guided,
                                                            const flow::SamplingExtras& extras = {},
                                                            flow::ViewRule rule = flow::ViewRule::kAverage);
};

}  // namespace anigen::generate
