"""Draws pictures of a scene with OpenGL: pyrender on EGL, with our own projection matrices.

There is one sample per pixel, and there are no lights and no mipmaps, so that a pixel is the point sample that
`renderer.sampling` defines. This is the only module that imports pyrender or OpenGL; `renderer.backends.raster` calls
it on the thread that owns the context.
"""

from __future__ import annotations

import os
import sys
import types
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ciir.errors import BackendUnavailable
from ciir.renderer.scene import SOLID

os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
UNUSED = {"viewer": "Viewer", "font": "FontCache", "scene": "Scene", "node": "Node", "mesh": "Mesh"}
"""pyrender's modules, and their classes, that nothing here uses. They import X libraries, which a server doesn't have,
fonts, trimesh and networkx: three quarters of OpenGL's start-up time."""


@contextmanager
def leave_out_unused() -> Iterator[None]:
    """Makes imports of pyrender inside the block skip `UNUSED`; a later import elsewhere gets all of it."""
    if "pyrender" in sys.modules:
        yield
        return
    for module, name in UNUSED.items():
        sys.modules[f"pyrender.{module}"] = types.ModuleType(f"pyrender.{module}")
        setattr(sys.modules[f"pyrender.{module}"], name, object)
    try:
        yield
    finally:
        for found in [found for found in sys.modules if found.partition(".")[0] == "pyrender"]:
            del sys.modules[found]


try:
    import OpenGL
    from OpenGL import GL

    with leave_out_unused():
        import pyrender
        from pyrender.platforms.egl import EGLPlatform, get_device_by_index
        from pyrender.shader_program import ShaderProgramCache
except (ImportError, AttributeError) as error:  # PyOpenGL raises AttributeError without libEGL
    raise BackendUnavailable(
        f"raster: OpenGL can't be loaded ({error}); install libegl1 and libgl1-mesa-dri, or take backend raytrace"
    ) from error

if sys.version_info >= (3, 12) and OpenGL.__version__ == "3.1.0":
    raise BackendUnavailable(
        "raster: PyOpenGL 3.1.0, which pyrender asks for, fails on Python 3.12 and newer; run pip install --no-deps "
        "PyOpenGL==3.1.10, or take backend raytrace"
    )

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from ciir.renderer.scene import Part, Scene

MAX_SIDE = 8192
"""Longest side of a framebuffer, in pixels."""
WRAP = {"repeat": GL.GL_REPEAT, "mirror": GL.GL_MIRRORED_REPEAT, "clamp": GL.GL_CLAMP_TO_EDGE}


class PointSampler(pyrender.Renderer):  # type: ignore[misc]
    """pyrender's renderer with one sample per pixel and our flat shader; it reads one channel back."""

    channel: Literal["color", "depth"] = "color"
    _main_fb: int | None
    _main_fb_dims: tuple[int, int]

    def __init__(self) -> None:
        super().__init__(1, 1)
        self._program_cache = ShaderProgramCache(shader_dir=str(Path(__file__).parent / "shaders"))

    def __del__(self) -> None:
        """Does nothing: pyrender's own would call OpenGL from any thread when the process ends."""

    def _configure_main_framebuffer(self) -> None:
        """Makes a framebuffer of the viewport's size with one sample per pixel; pyrender's averages four."""
        size = (self.viewport_width, self.viewport_height)
        if self._main_fb is not None and self._main_fb_dims == size:
            return
        self._delete_main_framebuffer()
        self._main_cb, self._main_db = GL.glGenRenderbuffers(2)
        self._main_fb = self._main_fb_ms = GL.glGenFramebuffers(1)
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._main_fb)
        for buffer, kind, attachment in (
            (self._main_cb, GL.GL_RGBA8, GL.GL_COLOR_ATTACHMENT0),
            (self._main_db, GL.GL_DEPTH_COMPONENT24, GL.GL_DEPTH_ATTACHMENT),
        ):
            GL.glBindRenderbuffer(GL.GL_RENDERBUFFER, buffer)
            GL.glRenderbufferStorage(GL.GL_RENDERBUFFER, kind, *size)
            GL.glFramebufferRenderbuffer(GL.GL_FRAMEBUFFER, attachment, GL.GL_RENDERBUFFER, buffer)
        self._main_fb_dims = size

    def _delete_main_framebuffer(self) -> None:
        if self._main_fb is not None:
            GL.glDeleteFramebuffers(1, [self._main_fb])
            GL.glDeleteRenderbuffers(2, [self._main_cb, self._main_db])
        self._main_fb = self._main_fb_ms = self._main_cb = self._main_db = None

    def _read_main_framebuffer(self, scene: object, flags: int) -> NDArray[Any]:  # noqa: ARG002 - pyrender's signature
        """Returns `(height, width, 4)` RGBA, or `(height, width)` of the depth buffer in [0, 1]; first row at the
        top.
        """
        width, height = self._main_fb_dims
        GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, self._main_fb)
        if self.channel == "depth":
            depth = GL.glReadPixels(0, 0, width, height, GL.GL_DEPTH_COMPONENT, GL.GL_FLOAT)
            return np.frombuffer(depth, np.float32).reshape(height, width)[::-1]
        pixels = GL.glReadPixels(0, 0, width, height, GL.GL_RGBA, GL.GL_UNSIGNED_BYTE)
        return np.frombuffer(pixels, np.uint8).reshape(height, width, 4)[::-1]

    def _sorted_mesh_nodes(self, scene: GlScene) -> list[GlScene]:
        """Returns the nodes in any order: nothing is blended, so the depth test alone decides."""
        return scene.mesh_nodes


class MatrixCamera(pyrender.Camera):  # type: ignore[misc]
    """A camera in the plane z = 0 that looks along -z; pyrender's own cameras derive the matrix from the viewport."""

    def __init__(self, matrix: NDArray[np.float64]) -> None:
        super().__init__(znear=1.0, zfar=2.0)
        self.matrix = matrix

    def get_projection_matrix(self, width: int | None = None, height: int | None = None) -> NDArray[np.float64]:  # noqa: ARG002
        """Returns the 4x4 matrix from camera to clip coordinates."""
        return self.matrix


class GlScene:
    """The part of pyrender's `Scene` that its renderer uses: one mesh without lights, and one camera, neither of them
    moved.
    """

    bg_color, lights, light_nodes, is_visible = (0.0, 0.0, 0.0, 0.0), (), (), True

    def __init__(self, primitives: list[pyrender.Primitive]) -> None:
        self.primitives, self.camera = primitives, MatrixCamera(np.eye(4))

    @property
    def mesh(self) -> GlScene:
        """The mesh, which has the primitives."""
        return self

    main_camera_node = mesh

    @property
    def mesh_nodes(self) -> list[GlScene]:
        """The nodes that have a mesh."""
        return [self]

    @property
    def meshes(self) -> set[GlScene]:
        """The meshes."""
        return {self}

    def get_pose(self, node: GlScene) -> NDArray[np.float64]:  # noqa: ARG002 - pyrender's signature
        """Returns the matrix from a node's coordinates to the scene's, `(4, 4)`."""
        return np.eye(4)


def to_primitive(part: Part, middle: NDArray[np.float64]) -> pyrender.Primitive:
    """Returns `part` as pyrender's primitive, relative to `middle` `(3,)` so that its distance costs float32 no digits.

    The vertex alpha is scaled so that the part's cutoff becomes one half, as the shader expects. See-through parts are
    cut out at `SOLID`.
    """
    colors = part.colors.astype(np.float32).copy()
    texture = None
    cutoff = SOLID if part.is_see_through else part.alpha_cutoff
    if cutoff:
        colors[:, 3] *= 0.5 / cutoff
    else:
        colors[:, 3] = 1.0
    if part.texture is not None and part.uv is not None:
        pixels = part.texture.pixels
        if not cutoff:
            pixels = pixels.copy()
            pixels[..., 3] = 255
        texture = pyrender.Texture(
            source=pixels,
            source_channels="RGBA",
            sampler=pyrender.Sampler(
                magFilter=GL.GL_NEAREST if part.texture.is_nearest else GL.GL_LINEAR,
                minFilter=GL.GL_NEAREST if part.texture.is_nearest else GL.GL_LINEAR,
                wrapS=WRAP[part.texture.wrap_u],
                wrapT=WRAP[part.texture.wrap_v],
            ),
        )
    return pyrender.Primitive(
        positions=(part.vertices - middle).astype(np.float32),
        indices=part.faces.astype(np.uint32),
        color_0=colors,
        normals=part.back_colors,  # the shader's `back_color`: nothing is lit here
        texcoord_0=None if part.uv is None else part.uv.astype(np.float32),
        material=pyrender.MetallicRoughnessMaterial(
            baseColorTexture=texture,
            baseColorFactor=[float(part.is_linear)] * 4,  # a flag for the shader; the colour is in the vertices
            doubleSided=not part.hides_back,
        ),
    )


@dataclass(frozen=True)
class Drawing:
    """One picture to draw."""

    projection: Callable[[float, float], NDArray[np.float64]]
    """Function that makes the 4x4 matrix from the distances of the near and the far plane."""
    height: int
    width: int
    place: tuple[float, float] = (0.0, 0.0)
    """x and y of the camera in the array's plane."""


class Context:
    """The EGL context with the scene loaded into it. Every method must run on the thread that created it."""

    def __init__(self) -> None:
        try:
            platform = EGLPlatform(1, 1, device=get_device_by_index(int(os.environ.get("EGL_DEVICE_ID", "0"))))
            platform.init_context()
            self._sampler = PointSampler()
        except (AssertionError, IndexError, ValueError, GL.error.Error) as error:
            raise BackendUnavailable(
                f"raster: no OpenGL context can be made ({type(error).__name__}: {str(error)[:80]}); install libegl1 "
                "and libgl1-mesa-dri, or take backend raytrace"
            ) from error
        self._platform = platform  # the context lives as long as this
        self.largest = min(MAX_SIDE, int(GL.glGetIntegerv(GL.GL_MAX_RENDERBUFFER_SIZE)))
        self._scene: Scene | None = None

    def load(self, scene: Scene) -> None:
        """Makes `scene` the one that is drawn. If that fails, the previous scene stays loaded."""
        if scene is self._scene:
            return
        bounds = scene.bounds()
        middle = bounds.mean(axis=0)
        gl_scene = GlScene([to_primitive(part, middle) for part in scene.parts])
        distance = -bounds[:, 2]
        far, near = (float(side) for side in distance)
        # The two planes must differ even for a flat sheet in the array's plane.
        margin = max(0.01 * (far - near) + 1e-6 * abs(far), 1e-6 * float((bounds[1] - bounds[0]).max()))
        self._gl_scene, self._middle, self._scene = gl_scene, middle, scene
        # The near plane of a perspective camera must lie in front of the camera.
        self.near = max(near - margin, near * 0.5) if near > 0 else near - margin
        self.far = far + margin

    def draw_color(self, drawing: Drawing) -> NDArray[np.uint8]:
        """Returns `(height, width, 4)` RGBA of the loaded scene; alpha is 0 where there is nothing."""
        return self._draw(drawing, "color")

    def draw_depth(self, drawing: Drawing) -> NDArray[np.float32]:
        """Returns `(height, width)`: the distance of the loaded scene from the camera's plane along -z in its units,
        +inf where there is nothing.

        `drawing` must be a parallel projection, whose depth buffer is linear. Its 24 bits resolve 6e-8 of the scene's
        extent in z, and the shader's float32 rounds to a few times that.
        """
        share = self._draw(drawing, "depth").astype(np.float64)
        return np.where(share < 1.0, self.near + share * (self.far - self.near), np.inf).astype(np.float32)

    def _draw(self, drawing: Drawing, channel: Literal["color", "depth"]) -> NDArray[Any]:
        from_camera = np.eye(4)
        from_camera[:3, 3] = self._middle - (*drawing.place, 0.0)
        self._gl_scene.camera.matrix = (
            drawing.projection(self.near, self.far) @ from_camera
        )  # in float64; OpenGL's is float32
        self._sampler.viewport_width, self._sampler.viewport_height = drawing.width, drawing.height
        self._sampler.channel = channel
        flags = pyrender.RenderFlags.OFFSCREEN | pyrender.RenderFlags.FLAT | pyrender.RenderFlags.RGBA
        pixels: NDArray[Any] = self._sampler.render(self._gl_scene, flags)
        return pixels
