#pragma once
#include <chrono>
#include <memory>
#include <string>

#include "anigen/train/distributed/c10d.h"
#include "anigen/train/distributed/launch_environment.h"
#include "anigen/train/distributed/shared_keys.h"

#if ANIGEN_HAS_C10D
namespace anigen::train {

using StorePtr = c10::intrusive_ptr<c10d::Store>;

/// Opens the rendezvous; keys carry its attempt. Waits until it is there.
/// @param serve rank 0's first: it keeps the values of a TCP rendezvous, unless the launcher does
/// @throws Error naming the rendezvous when it cannot be reached within `timeout`
StorePtr open_store(const Rendezvous& rendezvous, bool serve, std::chrono::milliseconds timeout);

/// The store as keys. Its reads do not wait for a value.
std::shared_ptr<SharedKeys> keys_of(StorePtr store);

}  // namespace anigen::train
#endif
