"""Marginal likelihood of many small Gaussian processes at once, with its exact gradient.

    y = f(x) + e,   f ~ GP(0, s² exp(−½ Σ_d (x_d − x'_d)² / ℓ_d²)),   e_i ~ N(0, σ² / w_i²)

in φ, the logarithms of ℓ_1 … ℓ_D, s² and σ².  With K = s² w_i w_j k_ij + σ² δ_ij, α = K⁻¹ (w y) and
A = α αᵀ − K⁻¹, the gradient of log p(y) is ½ tr(A ∂K/∂φ) (Rasmussen & Williams 2006, Eq. 5.9).  All
length scales share one matrix product, since Σ_ij M_ij (x_i − x_j)² = 2 Σ_i x_i² Σ_j M_ij − 2 xᵀ M x
for a symmetric M.  So an evaluation is a Cholesky factorisation, an inverse, and a few passes over
one triangle of the matrix.
"""

import math

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

CHUNK = 1 << 17
"""Matrix elements worked on at once, 1 MB: more falls out of the cache."""


class LogEvidence:
    """−log p(y | x) per point of B Gaussian processes, each with its own data.

    Two matrices are kept from call to call, since fresh memory costs as much as the arithmetic.

    Args:
        x: inputs [B, n, D].
        y: outputs [B, n].
        weight: w [B, n] > 0; 1 if left out.
    """

    def __init__(
        self, x: Float[Tensor, "b n d"], y: Float[Tensor, "b n"], weight: Float[Tensor, "b n"] | None = None
    ) -> None:
        self.x, self.y = x, y if weight is None else weight * y
        self._log_weight = torch.zeros_like(y) if weight is None else weight.log()
        n = x.shape[1]
        self._chunk = max(1, CHUNK // n**2)
        self._K, self._inverse = x.new_empty(2, self._chunk, n, n)

    def __call__(
        self, phi: Float[Tensor, "k p"], which: Int[Tensor, "k"], curvature: bool = False
    ) -> tuple[Float[Tensor, "k"], Float[Tensor, "k p"], Float[Tensor, "k p p"] | None]:
        """Values [b] in nats, gradients [b, P] and curvatures [b, P, P] at phi [b, P = D + 2] of the processes `which`.

        The curvature is the average of the observed and the expected information, up to second
        derivatives of K: ½ αᵀ (∂K/∂φ_k) K⁻¹ (∂K/∂φ_l) α (Gilmour, Thompson & Cullis 1995); never
        negative, and no dearer than a few passes over the matrix.  None unless asked for.

        All are nan where K is not positive definite to rounding.
        """
        parts = torch.arange(len(phi), device=phi.device).split(self._chunk)
        results = zip(*(self._evaluate(phi[part], which[part], curvature) for part in parts), strict=True)
        value, gradient, information = (torch.cat(pieces) / self.x.shape[1] for pieces in results)
        return value, gradient, information if curvature else None

    def _evaluate(self, phi: Tensor, which: Tensor, curvature: bool) -> tuple[Tensor, Tensor, Tensor]:
        x, y, log_weight = self.x[which], self.y[which], self._log_weight[which]
        b, n, D = x.shape
        z = x * (-phi[:, None, :D]).exp()
        half = log_weight - 0.5 * z.square().sum(-1)
        one, noise = torch.ones_like(half), phi[:, D + 1, None].exp()
        # log K = z_i·z_j − ½ |z_i|² − ½ |z_j|² + log s², as one product.
        left = torch.cat((z, torch.stack((half + phi[:, D, None], one), -1)), -1)
        right = torch.cat((z, torch.stack((one, half), -1)), -1)
        K = torch.matmul(left, right.mT, out=self._K[:b]).exp_()
        inverse = self._inverse[:b].copy_(K)
        diagonal = inverse.diagonal(dim1=1, dim2=2)
        diagonal += noise
        root, alpha = _invert(inverse, y)
        value = 0.5 * ((y * alpha).sum(-1) + n * math.log(2 * math.pi)) + (root.log() - log_weight).sum(-1)
        information = self._information(K, inverse, z, alpha, noise) if curvature else value[:0]
        A = alpha.square() - diagonal
        by_scale, by_noise = (K.diagonal(dim1=1, dim2=2) * A).sum(-1), (noise * A).sum(-1)
        # Off the diagonal one triangle of A ∘ K says it all; on it the distances are 0.
        M = torch.baddbmm(inverse, alpha[..., None], alpha[:, None], beta=-1, out=inverse).mul_(K).tril_(-1)
        products = _matmul(M, torch.cat((z, one[..., None]), -1))
        rows, columns = products[..., -1], M.sum(1)
        by_length = 2 * (z * ((rows + columns)[..., None] * z - 2 * products[..., :-1])).sum(1)
        gradient = torch.cat((by_length, torch.stack((by_scale + 2 * rows.sum(-1), by_noise), -1)), -1)
        return value, -0.5 * gradient, information

    @staticmethod
    def _information(K: Tensor, inverse: Tensor, z: Tensor, alpha: Tensor, noise: Tensor) -> Tensor:
        """½ αᵀ ∂_kK K⁻¹ ∂_lK α [b, P, P]; of `inverse` the lower triangle is read."""
        alpha, D = alpha[..., None], z.shape[-1]
        products = _matmul(K, torch.cat((alpha, z * alpha, z.square() * alpha), -1))
        K_alpha, K_z, K_zz = products.split((1, D, D), -1)
        derivatives = torch.cat((z.square() * K_alpha - 2 * z * K_z + K_zz, K_alpha, noise[..., None] * alpha), -1)
        return 0.5 * derivatives.mT @ _symmetric_matmul(inverse, derivatives)


def _on_lapack(matrix: Tensor) -> bool:
    """Whether SciPy's LAPACK works on the tensor in place; torch does the rest."""
    return matrix.device.type == "cpu" and matrix.dtype == torch.float64


def _invert(K: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
    """Diagonal of K's Cholesky factor and K⁻¹y, [B, n] each, nan where there is no factor; K becomes K⁻¹.

    Of K⁻¹ only the lower triangle is sure to be set.
    """
    if not _on_lapack(K):
        factor, info = torch.linalg.cholesky_ex(K)
        factor.masked_fill_(info[:, None, None] > 0, torch.nan)
        K.copy_(torch.cholesky_inverse(factor))
        return factor.diagonal(dim1=1, dim2=2), (K @ y[..., None])[..., 0]
    from scipy.linalg import blas, lapack  # SciPy takes long to load

    root, alpha = torch.empty_like(y), torch.empty_like(y)
    for matrix, right, diagonal, solution in zip(*(part.numpy() for part in (K, y, root, alpha)), strict=True):
        # LAPACK counts columns first: its upper triangle is our lower one.
        factor, info = lapack.dpotrf(matrix.T, lower=0, clean=0, overwrite_a=1)
        if info:
            diagonal[:] = solution[:] = np.nan
            continue
        diagonal[:] = factor.diagonal()
        lapack.dpotri(factor, lower=0, overwrite_c=1)
        solution[:] = blas.dsymv(1.0, factor, right, lower=0)
    return root, alpha


def _matmul(M: Tensor, right: Tensor) -> Tensor:
    """M @ right for a few columns, at which NumPy's BLAS is twice as fast as torch's on a CPU."""
    return torch.from_numpy(M.numpy() @ right.numpy()) if _on_lapack(M) else M @ right


def _symmetric_matmul(lower: Tensor, right: Tensor) -> Tensor:
    """Product of symmetric matrices, of which the lower triangle is read, with a few columns."""
    if not _on_lapack(lower):
        return (lower.tril() + lower.tril(-1).mT) @ right
    from scipy.linalg import blas  # SciPy takes long to load

    pairs = zip(lower.numpy(), right.numpy(), strict=True)
    return torch.from_numpy(np.stack([blas.dsymm(1.0, matrix.T, columns, lower=0) for matrix, columns in pairs]))
