#pragma once
#include <functional>
#include <map>
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::nn {

/// While one lives on a thread, cross attentions called there without gradients keep the keys and values of their dense
/// contexts. A sampler asks the same network for velocities at every step under the same one or two contexts, the
/// condition and its negative, so both are projected once instead of once per step.
///
/// A context is known again by being the same tensor; whoever changes it in place must not hold one of these.
class KeptContexts {
 public:
  KeptContexts();
  ~KeptContexts();
  KeptContexts(const KeptContexts&) = delete;
  KeptContexts& operator=(const KeptContexts&) = delete;

 private:
  friend std::vector<Tensor> kept(const void* owner, const Tensor& context,
                                  const std::function<std::vector<Tensor>()>& make);
  struct Entry {
    Tensor context;  // held, so that its address is not given to another
    std::vector<Tensor> made;
  };
  std::map<const void*, std::vector<Entry>> entries_;  // by owner, the newest last
  KeptContexts* outer_;                                // what lived on this thread before
};

/// make(), or what it gave this owner for the same tensor before, while a KeptContexts lives and no gradient is
/// recorded. The last two contexts of each owner are kept.
std::vector<Tensor> kept(const void* owner, const Tensor& context, const std::function<std::vector<Tensor>()>& make);

}  // namespace anigen::nn
