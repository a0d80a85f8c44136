#include "anigen/models/rignet/model.h"

#include "anigen/models/anymate/init.h"

namespace anigen::models::rignet {
namespace {

std::shared_ptr<torch::nn::Module> make_network(const RignetOptions& options) {
  switch (options.task) {
    case Task::kJoints:
      return std::make_shared<JointNetworkImpl>(options);
    case Task::kConnectivity:
      return std::make_shared<ConnectivityNetworkImpl>(options);
    case Task::kSkinning:
      return std::make_shared<SkinNetworkImpl>(options);
  }
  throw InputError("", "task", "is none of the known ones");
}

}  // namespace

RignetModelImpl::RignetModelImpl(const RignetOptions& options, nn::Init init) : options_(options) {
  network_ = register_module(name_of(options.task), make_network(options));
  if (init == nn::Init::kNone) return;
  anymate::default_layers(*network_);
  if (options.task == Task::kJoints) network<JointNetworkImpl>().start();
}

}  // namespace anigen::models::rignet
