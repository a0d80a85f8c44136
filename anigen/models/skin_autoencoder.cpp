#include "anigen/models/skin_autoencoder.h"

#include "anigen/core/error.h"

namespace anigen::models {

using torch::Tensor;

SkinAutoEncoderImpl::SkinAutoEncoderImpl(const SkinAutoEncoderOptions& options, nn::Init init) : options_(options) {
  options.validate();
  encoder_ = register_module("skin_encoder", SkinEncoder(options.encoder_config));
  decoder_ = register_module("skin_decoder", SkinDecoder(options.decoder_config));
  if (init == nn::Init::kNone) return;
  encoder_->initialize();
  decoder_->initialize();
}

SkinAutoEncoderImpl::Output SkinAutoEncoderImpl::forward(const std::vector<Tensor>& joints,
                                                         const std::vector<Tensor>& parents,
                                                         const std::vector<Tensor>& skin) {
  const SkeletonBatch skeletons = SkeletonBatch::from_lists(joints, parents);
  const JointCode code = encode_joints(skeletons);
  const Tensor vertex_features = encode_vertices(code, skeletons, skin);
  const nn::Ragged vertices = rows_of(skin);
  Output output;
  output.joint_embeds = skeletons.items.split(code.features);
  output.vert_embeds = vertices.split(vertex_features);
  output.skin = decode(vertex_features, vertices, code.features, skeletons);
  return output;
}

std::vector<Tensor> SkinAutoEncoderImpl::reconstruct_log(const SkeletonBatch& skeletons,
                                                         const std::vector<Tensor>& skin) {
  const JointCode code = encode_joints(skeletons);
  return decoder_->decode_log(encode_vertices(code, skeletons, skin), rows_of(skin), code.features, skeletons);
}

SkinAutoEncoderImpl::JointCode SkinAutoEncoderImpl::encode_joints(const SkeletonBatch& skeletons) {
  JointCode code;
  code.embeddings = encoder_->embed_joints(skeletons);
  code.features = encoder_->joint_features(code.embeddings);
  return code;
}

Tensor SkinAutoEncoderImpl::encode_vertices(const JointCode& joints, const SkeletonBatch& skeletons,
                                            const std::vector<Tensor>& skin) {
  return encoder_->vertex_features(joints.embeddings, skeletons.items, skin);
}

std::vector<Tensor> SkinAutoEncoderImpl::decode(const Tensor& vertex_features, const nn::Ragged& vertices,
                                                const Tensor& joint_features, const SkeletonBatch& skeletons) {
  return decoder_->decode(vertex_features, vertices, joint_features, skeletons);
}

std::vector<std::string> SkinAutoEncoderImpl::half_precision_modules() const {
  std::vector<std::string> names = {"skin_encoder.joint_embedder.blocks"};
  if (options_.use_fp16) names.insert(names.end(), {"skin_decoder.blocks_vertex", "skin_decoder.blocks_skin"});
  return names;
}

void SkinAutoEncoderImpl::convert_to_fp16() {
  if (!parameters().front().is_cuda()) throw NotSupportedError("", "", "fp16 on a CPU; move the model to a GPU first");
  const auto modules = named_modules();
  for (const std::string& name : half_precision_modules()) nn::cast_linears(*modules[name], torch::kHalf);
}

nn::Ragged rows_of(const std::vector<Tensor>& matrices) {
  std::vector<std::int64_t> rows;
  for (const Tensor& matrix : matrices) rows.push_back(matrix.size(0));
  return nn::Ragged(rows);
}

}  // namespace anigen::models
