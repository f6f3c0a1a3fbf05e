"""The solidity stage: whether the image nowhere covers itself, and how surely that is known.

Input: Analysis and the Orientation. Output: Question, whose answer is a Solidity. That det J keeps
its sign was the first question of docs/rooms/solidity.md; the second is whether the boundary meets
itself and winds once about every image. Samples answer it, or a proof on the faces that are built
(`embedding`): where that is to come, samples are looked at when they are asked for.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from pc2cad.domain.analysis import Analysis
from pc2cad.expression.identity import Verdict
from pc2cad.solidity.continuity import check_written, is_continuous
from pc2cad.solidity.face_mesh import FaceMesh, cut
from pc2cad.solidity.injectivity import check_injective, material_shell
from pc2cad.solidity.orientation import Orientation
from pc2cad.solidity.self_intersection import FEW_PAIRS, MOST_PAIRS


@dataclass(frozen=True)
class Solidity:
    """The evidence of samples that the map is injective inside its box."""

    #: inner images at which the boundary's winding number is 1
    images: int
    #: an overlap would be no deeper than this (model units)
    apart: float
    #: index of the outer shell in the boundary complex; the others are voids
    outer_shell: int
    #: a sentence where an overlap deeper than rounding is not excluded, or nothing
    warning: str = ""


@dataclass(frozen=True, eq=False)
class Question:
    """Whether the image is one solid, by samples: they are looked at when it is first asked.

    Where `faces` are made of the map and compared themselves, what is no quick refusal is left to
    them (`embedding`).
    """

    analysis: Analysis
    orientation: Orientation
    faces: bool = False

    @cached_property
    def _face_meshes(self) -> tuple[FaceMesh, ...]:
        return cut(self.analysis)

    @cached_property
    def answer(self) -> Solidity:
        """The evidence; raises NotASolidError (a subclass) where the image is no solid."""
        most = FEW_PAIRS if self.faces else MOST_PAIRS
        sign = self.orientation.sign
        found = check_injective(self.analysis, sign, self._face_meshes, most, self.continuous)
        return Solidity(found.images, found.apart, found.outer_shell, found.warning)

    @cached_property
    def can_wait(self) -> bool:
        """Whether nothing is left to samples once the built faces are proved to meet nowhere.

        So it is where the sign of det J is proved, M does not jump, and one shell of its boundary
        encloses material and all others voids (docs/rooms/solidity.md has the reason).
        """
        return (
            self.faces
            and self.orientation.verdict is Verdict.PROVED
            and self.continuous
            and self._material is not None
        )

    @cached_property
    def continuous(self) -> bool:
        """Whether it is proved that M does not jump."""
        return is_continuous(self.analysis.map.coordinates, self.orientation.models)

    @cached_property
    def _material(self) -> int | None:
        if len(self.analysis.boundary.shells) == 1:
            return 0
        return material_shell(self.analysis, self.orientation.sign, self._face_meshes)

    @property
    def outer_shell(self) -> int:
        """Index of the outer shell in the boundary complex; the others are voids."""
        return self.answer.outer_shell if self._material is None else self._material


def ask_solidity(analysis: Analysis, orientation: Orientation, faces: bool = False) -> Question:
    """Return the question whether the image is one solid, answered where that cannot wait.

    Raises NotASolidError (a subclass) where the image is no solid.
    """
    question = Question(analysis, orientation, faces)
    if not question.can_wait:
        question.answer  # noqa: B018
    check_written(analysis)
    return question
