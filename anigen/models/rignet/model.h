#pragma once
#include <memory>

#include "anigen/core/error.h"
#include "anigen/models/rignet/connectivity_network.h"
#include "anigen/models/rignet/joint_network.h"
#include "anigen/models/rignet/skin_network.h"
#include "anigen/nn/init.h"

namespace anigen::models::rignet {

/// One of RigNet's models (Xu et al. 2020), written from the description in reference anymate-baselines.md, 9.3. All
/// keys begin with the word of its task: `joints.*`, `connectivity.*`, `skin.*`. They are ours, not those of the
/// published checkpoints.
class RignetModelImpl : public torch::nn::Module {
 public:
  /// @param init kPublished: linear maps as PyTorch begins, the last one of JointNet at zero
  explicit RignetModelImpl(const RignetOptions& options, nn::Init init = nn::Init::kPublished);

  /// The network as its class: JointNetworkImpl, ConnectivityNetworkImpl or SkinNetworkImpl.
  /// @throws InputError when it is of another task
  template <typename Network>
  Network& network() {
    auto* found = dynamic_cast<Network*>(network_.get());
    if (found == nullptr) throw InputError("", "task", "'" + name_of(options_.task) + "' is another task");
    return *found;
  }

  const RignetOptions& options() const { return options_; }

 private:
  RignetOptions options_;
  std::shared_ptr<torch::nn::Module> network_;
};
TORCH_MODULE(RignetModel);

}  // namespace anigen::models::rignet
