#include "anigen/nn/mixed.h"

#include <atomic>

#include "anigen/nn/kernels/tiles.h"

namespace anigen::nn {

namespace {

std::atomic<bool> asked{false};

}  // namespace

bool mixed_products() { return asked && kernels::has_bf16_products(); }

void set_mixed_products(bool mixed) { asked = mixed; }

MixedProducts::MixedProducts(bool mixed) : before_(asked) { asked = mixed; }

MixedProducts::~MixedProducts() { asked = before_; }

}  // namespace anigen::nn
