#pragma once
#include <string>
#include <vector>

#include "anigen/train/distributed/c10d.h"
#include "anigen/train/distributed/launch_environment.h"

#if ANIGEN_HAS_C10D
namespace anigen::train {

/// The network devices of join_ranks(), and in words what they are.
struct GlooDevices {
  std::vector<std::shared_ptr<::gloo::transport::Device>> devices;
  std::string description;
};

/// @param local all ranks are on this machine @throws InputError for an interface that is not there
GlooDevices find_gloo_devices(const Rendezvous& rendezvous, bool local);

}  // namespace anigen::train
#endif
