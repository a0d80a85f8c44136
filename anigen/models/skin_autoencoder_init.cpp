#include "anigen/models/skin_autoencoder_init.h"

#include <cmath>
#include <string>

#include "anigen/nn/linear.h"

namespace anigen::models {
namespace {

using torch::Tensor;

constexpr double kGeluSecondMoment = 0.425;  // of a standard normal

bool ends_with(const std::string& text, const std::string& end) {
  return text.size() >= end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0;
}

// Xavier's variance is 2 / (in + out).
void set_variance(Tensor weight, double variance) {
  const auto sum = static_cast<double>(weight.size(0) + weight.size(1));
  weight.mul_(std::sqrt(variance * sum / 2.0));
}

double inputs(const Tensor& weight) { return static_cast<double>(weight.size(1)); }

}  // namespace

void rescale_to_unit_gain(SkinAutoEncoder& model) {
  const torch::NoGradGuard no_grad;
  const auto embed = static_cast<double>(model->options().encoder_config.jp_embed_dim);
  const auto channels = static_cast<double>(model->options().decoder_config.model_channels);
  for (const auto& part : model->named_modules("", /*include_self=*/false)) {
    if (part.value()->as<nn::MlpImpl>() != nullptr) {
      const auto parameters = part.value()->named_parameters();
      const Tensor &first = parameters["0.weight"], &second = parameters["2.weight"];
      const bool behind_embedding =
          ends_with(part.key(), "out_layer_vert.mlp") || ends_with(part.key(), "out_layer_joint.mlp");
      const bool makes_logits = ends_with(part.key(), "out_layer_vertex") || ends_with(part.key(), "out_layer_skin");
      const bool unit_length = behind_embedding && model->options().encoder_config.normalize_feat;
      set_variance(first, (unit_length ? embed : 1.0) / inputs(first));
      set_variance(second, (makes_logits ? 1.0 / std::sqrt(channels) : 1.0) / (kGeluSecondMoment * inputs(second)));
    } else if (ends_with(part.key(), "input_layer_vertex") || ends_with(part.key(), "input_layer_skin")) {
      const Tensor weight = part.value()->named_parameters()["weight"];
      set_variance(weight, 1.0 / inputs(weight));
    }
  }
}

}  // namespace anigen::models
