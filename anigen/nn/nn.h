#pragma once
/// Dense layers of all models: attention, norms, embeddings, transformer blocks, volumes; state dicts and run
/// folders. kernels/ holds the CPU kernels; torch.h is the one place that knows LibTorch versions.
#include "anigen/nn/attention.h"
#include "anigen/nn/blocks.h"
#include "anigen/nn/condition_cache.h"
#include "anigen/nn/embeddings.h"
#include "anigen/nn/gelu_erf.h"
#include "anigen/nn/host_tensor.h"
#include "anigen/nn/init.h"
#include "anigen/nn/int8_linear.h"
#include "anigen/nn/linear.h"
#include "anigen/nn/norms.h"
#include "anigen/nn/profile.h"
#include "anigen/nn/ragged_attention.h"
#include "anigen/nn/state_dict.h"
#include "anigen/nn/torch.h"
#include "anigen/nn/trainable.h"
#include "anigen/nn/volumes.h"
