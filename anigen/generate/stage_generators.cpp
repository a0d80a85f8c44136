#include "anigen/generate/stage_generators.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <system_error>
#include <utility>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/hash.h"
#include "anigen/core/log.h"
#include "anigen/data/rigged_item.h"
#include "anigen/data/view_files.h"
#include "anigen/data/voxel_files.h"
#include "anigen/generate/assemble.h"
#include "anigen/generate/latent_records.h"
#include "anigen/geometry/nearest_surface.h"
#include "anigen/io/arrays/npz.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/nn/init.h"
#include "anigen/vision/surface_features.h"

namespace anigen::generate {

namespace {

// One thread while it lives, where every layer is so small that a second one gains nothing: alone on the machine both
// ways take equally long, but beside other busy programs threads wait for each other at every operator.
class OneThreadIfSmall {
 public:
  // @param products multiplications of one linear layer of the model's width
  explicit OneThreadIfSmall(double products) : before_(at::get_num_threads()) {
    if (products < kWorthThreads) at::set_num_threads(1);
  }
  ~OneThreadIfSmall() { at::set_num_threads(before_); }
  OneThreadIfSmall(const OneThreadIfSmall&) = delete;
  OneThreadIfSmall& operator=(const OneThreadIfSmall&) = delete;

 private:
  static constexpr double kWorthThreads = 1 << 23;  // a millisecond or two of products

  int before_;
};

namespace fs = std::filesystem;
using sparse::SparseTensor;
using torch::Tensor;

Tensor finite(const Tensor& latent, const fs::path& maker) {
  const Tensor values = latent.detach().to(torch::kCPU, torch::kFloat32).contiguous();
  if (!torch::isfinite(values).all().item<bool>())
    throw InputError(maker.string(), "", "this model gives a latent that is not finite");
  return values;
}

// Voxel indices as files hold them: below 256.
Tensor byte_coords(const SparseTensor& latent) {
  return latent.support->coords().slice(1, 1).to(torch::kUInt8).contiguous();
}

ConfigReader dataset_args(const nn::RunModel& found) {
  return ConfigReader(found.run, found.config.string()).object("dataset").object("args");
}

data::SparseStructureOptions occupancy_options(const nn::RunModel& encoder) {
  ConfigReader args = dataset_args(encoder);
  data::SparseStructureOptions options;
  options.resolution = static_cast<int>(args.integer("resolution", 64, 1, 256));
  options.skl_dilation_iter = static_cast<int>(args.integer("skl_dilation_iter", 0, 0, 256));
  return options;
}

fs::path feature_file(const data::AssetId& asset, const std::string& model) {
  return asset.root / "features" / model / (asset.id + ".npz");
}

SparseTensor sparse_of(const data::VoxelRows& rows, const std::string& id, torch::Device device) {
  const data::RaggedVoxels voxels = data::collate_voxels({&rows}, {id});
  return {sparse::Support::create(voxels.coords, 1), voxels.feats.to(device)};
}

fs::path mesh_file(const data::AssetId& asset) { return asset.root / "assets" / (asset.id + ".glb"); }

/// @param occupied bool [R, R, R]
std::vector<geometry::Voxel> voxels_of(const Tensor& occupied) {
  const Tensor places = torch::nonzero(occupied).to(torch::kCPU, torch::kInt32).contiguous();
  std::vector<geometry::Voxel> voxels;
  const auto* place = places.data_ptr<std::int32_t>();
  for (std::int64_t i = 0; i < places.size(0); ++i, place += 3) voxels.push_back({place[0], place[1], place[2]});
  return voxels;
}

std::vector<geometry::Voxel> parts_of(const geometry::Voxel& voxel, int factor) {
  std::vector<geometry::Voxel> parts;
  for (int x = 0; x < factor; ++x) {
    for (int y = 0; y < factor; ++y) {
      for (int z = 0; z < factor; ++z)
        parts.push_back({factor * voxel[0] + x, factor * voxel[1] + y, factor * voxel[2] + z});
    }
  }
  return parts;
}

/// Voxels of the stored grid that coarser ones stand for: those of the surface, else the factor² nearest to it, about
/// as many as a plane meets. @param surface sorted
std::vector<geometry::Voxel> stored_voxels(const std::vector<geometry::Voxel>& coarse, int factor,
                                           const std::vector<geometry::Voxel>& surface, const Mesh& mesh) {
  if (factor == 1) return coarse;
  const geometry::NearestSurface nearest(mesh);
  std::vector<geometry::Voxel> stored;
  for (const geometry::Voxel& voxel : coarse) {
    const std::vector<geometry::Voxel> parts = parts_of(voxel, factor);
    const std::size_t before = stored.size();
    for (const geometry::Voxel& part : parts) {
      if (std::binary_search(surface.begin(), surface.end(), part)) stored.push_back(part);
    }
    if (stored.size() > before) continue;
    std::vector<std::pair<double, geometry::Voxel>> by_distance;
    for (const geometry::Voxel& part : parts)
      by_distance.emplace_back(nearest.query(geometry::voxel_center(part, data::kStoredResolution)).distance, part);
    std::sort(by_distance.begin(), by_distance.end());
    for (int i = 0; i < factor * factor; ++i) stored.push_back(by_distance[static_cast<std::size_t>(i)].second);
  }
  geometry::sort_unique(stored);
  return stored;
}

}  // namespace

void write_structure_latents(const fs::path& file, const Tensor& shape, const Tensor& skeleton, const fs::path& maker) {
  io::write_npz(file,
                {{"mean", nn::to_array(finite(shape, maker))}, {"mean_skl", nn::to_array(finite(skeleton, maker))}});
}

void write_structured_latents(const fs::path& file, const structured_latent::PerStream<SparseTensor>& latents,
                              const fs::path& maker, std::optional<std::size_t> view) {
  TORCH_CHECK(latents.geometry.support->items().items() == 1 && latents.skeleton.support->items().items() == 1,
              "structured latents of several assets in one file");
  const Tensor feats = torch::cat({finite(latents.geometry.feats, maker), finite(latents.skin.feats, maker)}, 1);
  io::NamedArrays arrays{{"coords", nn::to_array(byte_coords(latents.geometry))},
                         {"feats", nn::to_array(feats)},
                         {"coords_skl", nn::to_array(byte_coords(latents.skeleton))},
                         {"feats_skl", nn::to_array(finite(latents.skeleton.feats, maker))}};
  if (view)
    arrays.emplace_back("view", nn::to_array(torch::full({1}, static_cast<std::int64_t>(*view), torch::kInt64)));
  io::write_npz(file, arrays);
}

sparse::SupportPtr support_of(const Tensor& occupied) {
  const Tensor places = torch::nonzero(occupied).to(torch::kInt32);
  const Tensor item = torch::zeros({places.size(0), 1}, torch::kInt32);
  return sparse::Support::create(torch::cat({item, places}, 1), 1);
}

StructureCoder::StructureCoder(const std::filesystem::path& run, const std::string& ckpt, torch::Device device,
                               bool decodes)
    : device_(device),
      found_(nn::find_run_model(run, sparse_structure::kSparseStructureEncoderClass, ckpt)),
      options_(occupancy_options(found_)),
      encoder_(nn::load_trained<sparse_structure::SparseStructureEncoder>(found_, device)) {
  if (encoder_->options().encode_global || encoder_->options().encode_global_skl)
    throw NotSupportedError(found_.config.string(), found_.pointer + "/encode_global", "latents of global tokens");
  if (decodes) {
    decoder_ = nn::load_trained<sparse_structure::SparseStructureDecoder>(
        nn::find_run_model(run, sparse_structure::kSparseStructureDecoderClass, ckpt), device);
  }
}

std::string StructureCoder::fingerprint() const {
  return sha256(fingerprint_of_files({found_.checkpoint}) + found_.args.dump() + "/" +
                std::to_string(options_.resolution) + "/" + std::to_string(options_.skl_dilation_iter));
}

data::SparseStructureBatch StructureCoder::voxels(const data::AssetId& asset) const {
  // One asset: its own errors, and nothing to leave out or replace.
  const data::SparseStructureDataset one({asset}, options_, 0);
  const std::unique_ptr<data::Batch> batch = one.load({data::Draw{0, 0}});
  return dynamic_cast<const data::SparseStructureBatch&>(*batch);
}

void StructureCoder::encode(const data::SparseStructureBatch& voxels, const std::filesystem::path& file) {
  const auto latent =
      encoder_->forward(voxels.ss.to(device_, torch::kFloat32), voxels.ss_skl.to(device_, torch::kFloat32));
  write_structure_latents(file, latent.mean[0], latent.mean_skl[0], found_.checkpoint);
}

StructureReconstruction StructureCoder::agreement(const data::StructureLatent& latent,
                                                  const data::SparseStructureBatch& voxels) {
  const auto tensor = [&](const data::LatentGrid& grid) {
    const auto& s = grid.shape;
    return torch::tensor(grid.values).view({1, s[0], s[1], s[2], s[3]}).to(device_);
  };
  const sparse_structure::VoxelPair decoded = decode(tensor(latent.mean), tensor(latent.mean_skl));
  return {sparse_structure::voxel_agreement(decoded.shape, voxels.ss[0][0] > 0),
          sparse_structure::voxel_agreement(decoded.skeleton, voxels.ss_skl[0][0] > 0)};
}

sparse_structure::VoxelPair StructureCoder::reconstruct(const data::SparseStructureBatch& voxels) {
  const torch::NoGradGuard no_grad;
  const auto latent =
      encoder_->forward(voxels.ss.to(device_, torch::kFloat32), voxels.ss_skl.to(device_, torch::kFloat32));
  return decode(latent.mean, latent.mean_skl);
}

sparse_structure::VoxelPair StructureCoder::decode(const Tensor& mean, const Tensor& mean_skl) {
  const auto logits = decoder_->forward(mean, mean_skl);
  const auto occupied = [](const Tensor& grid) { return (grid[0][0] > 0).to(torch::kCPU); };
  return {occupied(logits.shape), occupied(logits.skeleton)};
}

StructureGenerator::StructureGenerator(const Request& request)
    : FlowGenerator(request, {sparse_structure::kSparseStructureFlowClass},
                    "ImageConditionedAniGenSparseStructureLatent", "AniGenSparseStructureLatent"),
      autoencoder_(request.autoencoder) {
  if (autoencoder_.empty())
    autoencoder_ = nn::named_run(run_, reading_.ss_dec_path, flow_.config, "/dataset/args/ss_dec_path");
  decoder_ = nn::load_trained<sparse_structure::SparseStructureDecoder>(
      nn::find_run_model(autoencoder_, sparse_structure::kSparseStructureDecoderClass, reading_.ss_dec_ckpt), device_);
}

flow::Streams StructureGenerator::noise(std::uint64_t seed, std::uint64_t number) const {
  return noise(nn::numbered_generator(seed, "structure noise", number));
}

flow::Streams StructureGenerator::noise(const at::Generator& generator) const {
  const sparse_structure::SparseStructureFlowOptions& options = model_->options();
  const std::int64_t r = options.resolution;
  const Tensor shape = torch::randn({1, options.in_channels, r, r, r}, generator);
  const Tensor skeleton = torch::randn({1, options.in_channels_skl, r, r, r}, generator);
  return {shape.to(device_), skeleton.to(device_)};
}

flow::Streams StructureGenerator::sample(const flow::Streams& noise, const Tensor& condition,
                                         const flow::SamplerOptions& sampler, bool guided,
                                         const flow::SamplingExtras& extras, flow::ViewRule rule) {
  const torch::NoGradGuard no_grad;
  const auto width = static_cast<double>(std::max(options().model_channels, options().model_channels_skl));
  const OneThreadIfSmall threads(static_cast<double>(noise[0].size(0) * options().tokens()) * width * width);
  const auto under = [&](const Tensor& one) {
    return sparse_structure::structure_velocities(model_, one, guided, finds_skeletons());
  };
  const flow::Velocities velocities =
      noise[0].size(0) == 1 ? flow::under_views(condition, rule, sampler, under) : under(condition);
  return flow::sample_flow(noise, velocities, sampler, extras).samples;
}

Tensor StructureGenerator::shape_latent(const Tensor& voxels) {
  const torch::NoGradGuard no_grad;
  if (encoder_.is_empty()) {
    encoder_ = nn::load_trained<sparse_structure::SparseStructureEncoder>(
        nn::find_run_model(autoencoder_, sparse_structure::kSparseStructureEncoderClass, reading_.ss_dec_ckpt),
        device_);
  }
  const Tensor grid = voxels.to(device_, torch::kFloat32).unsqueeze(0).unsqueeze(0);
  const Tensor latent = encoder_->encode_shape(grid).mean;
  if (latent.size(-1) != options().resolution) {
    throw InputError(flow_.config.string(), "/models/denoiser/args/resolution",
                     std::to_string(options().resolution) + ", but voxels of " + std::to_string(voxels.size(0)) +
                         " on a side become a latent of " + std::to_string(latent.size(-1)));
  }
  return data::normalised(latent, reading_.normalization);
}

// A voxel too many costs the second flow little, since its votes are grouped; a missing limb stays missing. Chosen with
// the values that kTrustedAgreement was chosen by.
constexpr double kSkeletonLogit = -2.0;

std::string StructureGenerator::fingerprint() const {
  const nn::RunModel decoder =
      nn::find_run_model(autoencoder_, sparse_structure::kSparseStructureDecoderClass, reading_.ss_dec_ckpt);
  return fingerprint_of_files({flow_.checkpoint, flow_.config, decoder.checkpoint});
}

StructureGenerator::FoundSkeleton StructureGenerator::skeleton_of(const Tensor& voxels, const flow::Streams& noise) {
  const torch::NoGradGuard no_grad;
  const auto logits_of = [&](const Tensor& shape) {
    const flow::Streams found = sample({shape_latent(shape), noise[1]}, condition({}), sampler(), /*guided=*/false);
    return logits(found, 0).skeleton[0][0].to(torch::kCPU);
  };
  const Tensor own = logits_of(voxels), mirrored = logits_of(voxels.flip({kGridAcross})).flip({kGridAcross});
  const double common = ((own > 0) & (mirrored > 0)).sum().item<double>(),
               either = ((own > 0) | (mirrored > 0)).sum().item<double>();
  return {sparse_structure::largest_component((0.5 * (own + mirrored) > kSkeletonLogit).contiguous()),
          common / std::max(1.0, either)};
}

flow::Streams StructureGenerator::denormalised(const flow::Streams& latents) const {
  return {data::denormalised(latents[0].to(device_), reading_.normalization),
          data::denormalised(latents[1].to(device_), reading_.normalization_skl)};
}

sparse_structure::SparseStructureDecoderImpl::Logits StructureGenerator::logits(const flow::Streams& latents,
                                                                                std::int64_t item) {
  const torch::NoGradGuard no_grad;
  const flow::Streams one = denormalised({latents[0].narrow(0, item, 1), latents[1].narrow(0, item, 1)});
  return decoder_->forward(one[0], one[1]);
}

std::vector<sparse_structure::VoxelPair> StructureGenerator::decode(const flow::Streams& latents) {
  const torch::NoGradGuard no_grad;
  std::vector<sparse_structure::VoxelPair> decoded;
  for (std::int64_t i = 0; i < latents[0].size(0); ++i) {  // one by one: a batch of 64³ volumes is large
    const auto logits = this->logits(latents, i);
    const auto occupied = [](const Tensor& grid) { return (grid[0][0] > 0).to(torch::kCPU).contiguous(); };
    const Tensor skeleton = occupied(logits.skeleton);
    decoded.push_back({occupied(logits.shape),
                       shape_alone() ? torch::zeros_like(skeleton) : sparse_structure::largest_component(skeleton)});
  }
  return decoded;
}

RigDecoder::RigDecoder(const nn::RunModel& found, torch::Device device,
                       const skeleton_field::MeanShiftOptions& grouping, Decodes decodes)
    : decodes_(decodes),
      variant_(structured_latent::variant_of_run(found)),
      grouping_(structured_latent::in_form_of(structured_latent::grouping_of_run(grouping, found.config.parent_path()),
                                              variant_)),
      decoder_(decodes == Decodes::kShapes ? nn::load_trained<structured_latent::StructuredLatentDecoder>(found, device)
                                           : structured_latent::load_rig_decoder(found, device, grouping)) {}

RigDecoder::Decoded RigDecoder::decode(const structured_latent::PerStream<sparse::SparseTensor>& latents,
                                       const skeleton_field::SkeletonTensors* given, const std::string& name) {
  const torch::NoGradGuard no_grad;
  if (decodes_ == Decodes::kShapes) {
    Decoded shape;
    shape.asset = decoded_shape(decoder_->decode_shapes(latents.geometry).front(), name);
    return shape;
  }
  std::vector<skeleton_field::SkeletonTensors> skeletons;
  if (given != nullptr) skeletons.push_back(*given);
  const auto decoded = decoder_->forward(latents, skeletons);
  const shape_field::ExtractedMesh mesh = decoder_->extract_meshes(decoded, /*training=*/false).front();
  const skeleton_field::SkeletonTensors& skeleton = decoded.joints.front();
  const SkinWeightRows weights = [&](std::int64_t begin, std::int64_t end) {
    return decoder_->skin_weights(mesh.skin_features.slice(0, begin, end), skeleton,
                                  decoded.joint_features.front().features);
  };
  DecodedAssetOptions options;
  options.name = name;
  return {decoded_asset(mesh, skeleton, weights, options),
          structured_latent::for_grouping(decoded.skeletons.front(), variant_.confidence)};
}

skeleton_field::SkeletonField RigDecoder::votes(const structured_latent::PerStream<sparse::SparseTensor>& latents) {
  const torch::NoGradGuard no_grad;
  return structured_latent::for_grouping(decoder_->rig_fields(latents).skeletons.front(), variant_.confidence);
}

skeleton_field::SkeletonTensors RigDecoder::grouped(const skeleton_field::SkeletonField& votes) const {
  return skeleton_field::group_votes(votes, decoder_->options().grouping_strategy, grouping_);
}

StructuredLatentCoder::StructuredLatentCoder(const fs::path& run, const std::string& ckpt, torch::Device device,
                                             const std::optional<skeleton_field::MeanShiftOptions>& decodes)
    : device_(device), found_(nn::find_run_model(run, structured_latent::kStructuredLatentEncoderClass, ckpt)) {
  ConfigReader args = dataset_args(found_);
  data_ = data::FeatureSkeletonOptions::read(args);
  const nn::RunModel decoder = nn::find_run_model(run, structured_latent::kStructuredLatentDecoderClass, ckpt);
  variant_ = structured_latent::variant_of_run(decoder);
  if (variant_.latent_norm == structured_latent::LatentNorm::kNone) found_.args["normalize_z"] = false;
  encoder_ = nn::load_trained<structured_latent::StructuredLatentEncoder>(found_, device);
  if (decodes)
    decoder_.emplace(decoder, device, *decodes,
                     shape_alone() ? RigDecoder::Decodes::kShapes : RigDecoder::Decodes::kRigs);
}

std::string StructuredLatentCoder::fingerprint() const {
  return sha256(fingerprint_of_files({found_.checkpoint}) + found_.args.dump() + "/" + data_.model + "/" +
                std::to_string(data_.skl_dilation_iter) + "/" + std::to_string(data_.load_cubvh) + "/" +
                std::to_string(data_.skin_accum_as_flow) + "/" + std::to_string(data_.resolution) + "/" +
                std::to_string(static_cast<int>(variant_.latent_norm)) + (variant_.geometry_dae ? "/dae" : ""));
}

std::vector<fs::path> StructuredLatentCoder::files(const data::AssetId& asset) const {
  return {feature_file(asset, data_.model), data::skeleton_voxel_path(asset), data::rig_path(asset)};
}

StructuredLatentCoder::Inputs StructuredLatentCoder::inputs(const data::AssetId& asset) const {
  data::VoxelRows skeleton;
  skeleton.coords = data::read_voxels_at(data::skeleton_voxel_path(asset), data_.resolution);
  if (data_.skl_dilation_iter > 0)
    skeleton.coords = geometry::dilate(skeleton.coords, data_.resolution, data_.skl_dilation_iter);
  data::RigArrays rig = data::read_rig_arrays(asset);
  const std::size_t unweighted = data::normalize_skin_rows(rig.skin, rig.joints.size());
  if (unweighted > 0) {
    log::warn("{}: {} of {} vertices have no weight and follow joint 0, as published", asset.id, unweighted,
              rig.vertices.size());
  }
  if (data_.skin_accum_as_flow) data::accumulate_skin_as_flow(rig.skin, rig.parents);
  data::RigBatch batch;
  batch.append(rig);

  Inputs inputs;
  inputs.x = sparse_of(data::read_features_at(feature_file(asset, data_.model), data_.resolution), asset.id, device_);
  inputs.x_skl = sparse_of(skeleton, asset.id, device_);
  inputs.rigs.joints = {batch.joints.front().to(device_)};
  inputs.rigs.parents = {batch.parents.front().to(device_)};
  inputs.rigs.skin = {batch.skin.front().to(device_)};
  inputs.rigs.vertices = batch.vertices;
  inputs.rigs.faces = batch.faces;
  if (data_.load_cubvh) {
    inputs.rigs.surfaces = {std::make_shared<const geometry::NearestSurface>(rig.vertices, rig.faces)};
  }
  return inputs;
}

StructuredLatentCoder::Inputs StructuredLatentCoder::inputs_with_skeleton(const data::AssetId& asset,
                                                                          const Tensor& skeleton) const {
  if (skeleton.size(0) != data_.resolution) {
    throw InputError(
        found_.config.string(), "/dataset/args/resolution",
        std::to_string(data_.resolution) + ", but the skeleton's voxels are of " + std::to_string(skeleton.size(0)));
  }
  data::VoxelRows rows;
  rows.coords = voxels_of(skeleton);
  Inputs moved = inputs(asset);
  moved.x_skl = sparse_of(rows, asset.id, device_);
  return moved;
}

void StructuredLatentCoder::require_features_anywhere(const data::AssetId& asset) const {
  if (data_.model != "surface")
    throw NotSupportedError(found_.config.string(), "/dataset/args/model",
                            "features '" + data_.model + "' at voxels that the dataset does not have; 'surface' are");
  std::error_code error;
  if (!fs::is_regular_file(mesh_file(asset), error))
    throw NotSupportedError(mesh_file(asset).string(), "",
                            "features at other voxels without the asset's mesh (anigen-prepare --no-assets)");
}

StructuredLatentCoder::Inputs StructuredLatentCoder::inputs_at(const data::AssetId& asset,
                                                               const sparse_structure::VoxelPair& voxels) const {
  require_features_anywhere(asset);
  const int factor = data::kStoredResolution / data_.resolution;
  const Asset mesh = io::read_gltf(mesh_file(asset)).asset;
  std::vector<geometry::Voxel> surface = data::read_voxels_at(data::surface_voxel_path(asset), data::kStoredResolution);
  geometry::sort_unique(surface);
  data::VoxelRows shape, skeleton;
  shape.coords = stored_voxels(voxels_of(voxels.shape), factor, surface, mesh.mesh);
  const Tensor feats =
      nn::to_tensor(vision::SurfaceFeatures().extract({mesh, shape.coords, data::kStoredResolution, {}}))
          .to(torch::kFloat32)
          .contiguous();
  shape.channels = static_cast<std::size_t>(feats.size(1));
  shape.feats.assign(feats.data_ptr<float>(), feats.data_ptr<float>() + feats.numel());
  if (factor > 1) {
    geometry::PooledVoxels pooled = geometry::pool_features(shape.coords, shape.feats, shape.channels, factor);
    shape.coords = std::move(pooled.voxels);
    shape.feats = std::move(pooled.features);
  }
  skeleton.coords = voxels_of(voxels.skeleton);
  Inputs moved = inputs(asset);
  moved.x = sparse_of(shape, asset.id, device_);
  moved.x_skl = sparse_of(skeleton, asset.id, device_);
  return moved;
}

structured_latent::PerStream<SparseTensor> StructuredLatentCoder::encode(const Inputs& inputs) {
  const torch::NoGradGuard no_grad;
  const auto latents = encoder_->forward(inputs.x, inputs.x_skl, inputs.rigs);
  const structured_latent::StructuredLatentEncoderOptions& options = encoder_->options();
  return {latents.z.with(structured_latent::geometry_latent(latents.z_geometry, options, variant_)),
          latents.z.with(structured_latent::renormalized(latents.z_skin, options, variant_.latent_norm)),
          latents.z_skl.with(structured_latent::renormalized(latents.z_skl.feats, options, variant_.latent_norm))};
}

RigDecoder::Decoded StructuredLatentCoder::decode(const structured_latent::PerStream<SparseTensor>& latents,
                                                  const skeleton_field::SkeletonTensors& own, bool use_own,
                                                  const std::string& name) {
  return decoder_->decode(latents, use_own ? &own : nullptr, name);
}

void StructuredLatentCoder::write(const structured_latent::PerStream<SparseTensor>& latents, const fs::path& file,
                                  std::optional<std::size_t> view) const {
  write_structured_latents(file, latents, checkpoint(), view);
}

StructuredLatentGenerator::StructuredLatentGenerator(const FlowRequest& request)
    : FlowGenerator(request,
                    {structured_latent::kStructuredLatentFlowClass, structured_latent::kPlainStructuredLatentFlowClass},
                    "AniGenImageConditionedSLat", "AniGenSLat") {}

flow::Streams StructuredLatentGenerator::noise(const sparse::Support& shape, const sparse::Support& skeleton,
                                               const at::Generator& generator) const {
  flow::Streams streams =
      structured_latent::structured_latent_noise(model_->options(), shape, skeleton, training_.smoothing, generator);
  for (Tensor& stream : streams) stream = stream.to(device_);
  return streams;
}

structured_latent::PerStream<sparse::SparseTensor> StructuredLatentGenerator::sample(
    const flow::Streams& noise, const structured_latent::StructuredLatentTarget& target,
    const flow::SamplerOptions& sampler, bool guided, const flow::SamplingExtras& extras, flow::ViewRule rule) {
  const torch::NoGradGuard no_grad;
  const auto under = [&](const Tensor& one) {
    structured_latent::StructuredLatentTarget seen = target;
    seen.tokens = one;
    return structured_latent::structured_latent_velocities(model_, seen, guided);
  };
  const flow::Velocities velocities = target.shape->items().items() == 1
                                          ? flow::under_views(target.tokens, rule, sampler, under)
                                          : under(target.tokens);
  const flow::Streams latents = flow::sample_flow(noise, velocities, sampler, extras).samples;
  const Tensor shape = data::denormalised(latents[0], reading_.normalization);
  const Tensor skeleton = data::denormalised(latents[1], reading_.normalization_skl);
  const std::int64_t geometry = model_->options().geometry.out_channels;
  return {{target.shape, shape.slice(1, 0, geometry).contiguous()},
          {target.shape, shape.slice(1, geometry).contiguous()},
          {target.skeleton, skeleton}};
}

}  // namespace anigen::generate
