#pragma once
#include <memory>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "anigen/core/config_fields.h"
#include "anigen/core/log.h"
#include "anigen/train/stages/stages.h"

namespace anigen::train {

/// Stage that trains one model of ours on the pictures of a dataset of ours. `StageClass` adds losses() and evaluate()
/// and inherits the constructor; `Options` has fields(ConfigFields&), its arguments beside those all trainers share.
template <typename StageClass, typename ModelClass, typename DatasetClass, typename OptionsStruct>
class PictureStage : public Stage {
 public:
  using Model = ModelClass;
  using Dataset = DatasetClass;
  using Options = OptionsStruct;
  using ModelOptions = std::decay_t<decltype(std::declval<Model&>()->options())>;

  /// @param held_out null: nothing is evaluated @param name of the model in the config
  PictureStage(const ModelOptions& model, Options options, std::shared_ptr<const data::BatchSource> data,
               std::shared_ptr<const Dataset> held_out, std::string name, torch::Device device)
      : options_(std::move(options)),
        data_(std::move(data)),
        held_out_(std::move(held_out)),
        name_(std::move(name)),
        device_(device),
        model_(model) {
    model_->to(device_);
  }

  std::vector<nn::NamedModel> models() const override { return {{name_, model_.ptr()}}; }
  const data::BatchSource& data() const override { return *data_; }
  void set_data(std::shared_ptr<const data::BatchSource> data) override { data_ = std::move(data); }
  std::unique_ptr<Stage> replica() const override {
    return std::make_unique<StageClass>(model_->options(), options_, data_, held_out_, name_, device_);
  }

 protected:
  Options options_;
  std::shared_ptr<const data::BatchSource> data_;
  std::shared_ptr<const Dataset> held_out_;
  std::string name_;
  torch::Device device_;
  Model model_;
};

/// The stage of a config. @param check called with the model's options, its arguments and the training data; throws
/// where they do not fit each other @throws InputError also for another dataset, or pictures of another size
template <typename StageClass, typename Check>
std::unique_ptr<Stage> make_picture_stage(const StageRequest& request, const char* model_class,
                                          const char* dataset_class, const Check& check) {
  using Dataset = typename StageClass::Dataset;
  typename StageClass::Options options;
  ConfigFields f(request.args);
  options.fields(f);
  ConfigReader top(request.config, request.file);
  const auto [name, model] = read_only_model<typename StageClass::ModelOptions>(top, {model_class});
  const data::Datasets datasets = data::make_datasets(top.object("dataset"), request.trainer.seed);
  const auto pictures = std::dynamic_pointer_cast<const Dataset>(datasets.train);
  if (!pictures) {
    throw top.object("dataset").error("name", std::string("this trainer needs the dataset ") + dataset_class);
  }
  const ConfigReader args = top.object("models").object(name).object("args");
  check(model, args, *pictures);
  if (model.image_size != pictures->options().image_size)
    throw args.error("image_size", "differs from the dataset's image_size");
  const auto held_out = std::dynamic_pointer_cast<const Dataset>(datasets.eval);
  log::info("{} assets to train on, {} held out", pictures->assets(), held_out ? held_out->assets() : 0);
  return std::make_unique<StageClass>(model, options, datasets.train, held_out, name, request.device);
}

}  // namespace anigen::train
