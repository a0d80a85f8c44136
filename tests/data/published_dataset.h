#pragma once
#include <memory>
#include <string>

#include "anigen/core/config.h"
#include "anigen/data/datasets.h"
#include "tests/train/stages/published_sample.h"

namespace anigen::test {

inline data::Datasets make_published(const PublishedSample& sample, const std::string& name, Json args,
                                     std::uint64_t seed = 1) {
  if (!args.contains("data_dir")) args["data_dir"] = sample.root().string();
  const Json dataset = {{"name", name}, {"args", args}};
  return data::make_datasets(ConfigReader(dataset, "config.json", "/dataset"), seed);
}

/// Arguments that fit the sample.
inline Json feature_args() {
  return {{"image_size", 16}, {"model", "dino"}, {"min_aesthetic_score", 4.5}, {"test_mode", false}};
}
inline Json structure_latent_args() { return {{"latent_model", "ss"}, {"image_size", 6}}; }
inline Json latent_args() { return {{"latent_model", "slat"}, {"image_size", 6}}; }

template <typename BatchType>
std::unique_ptr<BatchType> load(const data::BatchSource& source, const std::vector<data::Draw>& draws) {
  std::unique_ptr<data::Batch> batch = source.load(draws);
  auto* typed = dynamic_cast<BatchType*>(batch.get());
  if (typed == nullptr) throw std::runtime_error("another kind of batch");
  static_cast<void>(batch.release());
  return std::unique_ptr<BatchType>(typed);
}

}  // namespace anigen::test
