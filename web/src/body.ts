// A body as it is drawn: its surface never leaves the graphics card, only node positions go there.
import {
  BufferAttribute,
  BufferGeometry,
  Color,
  DataTexture,
  DynamicDrawUsage,
  FloatType,
  Group,
  LineBasicMaterial,
  LineSegments,
  Mesh,
  MeshDepthMaterial,
  MeshLambertMaterial,
  MeshPhysicalMaterial,
  MeshStandardMaterial,
  NearestFilter,
  RGBADepthPacking,
  RGBAFormat,
  type IUniform,
  type Material,
  type Texture,
} from 'three';
import { NODE_FLOATS, NodeField, embedAll, shadingSurface } from './embedding.ts';
import { TIED_KINDS, tiedNodes } from './attached.ts';
import type { AttachmentInfo, BodyGeometry } from './protocol.ts';

/** A share of the weights at attached nodes this high is all handle: as in the pictures of `palpate run`. */
const HELD_SHARE = 0.45;

function blended(share: number): number {
  const t = Math.min(1, Math.max(0, share / HELD_SHARE));
  return t * t * (3 - 2 * t);
}

const SHADER_HEAD = /* glsl */ `
uniform highp sampler2D uNodes;
uniform int uWidth;
attribute vec4 aNodes;
attribute vec4 aWeights;
attribute float aHeld;
attribute vec3 aTied;
varying float vHeld;
varying vec3 vTied;
varying float vValue;
vec4 nodeTexel(int node, int k) {
  int i = 4 * node + k;
  return texelFetch(uNodes, ivec2(i % uWidth, i / uWidth), 0);
}
vec4 embedPosition() {
  vec4 p = vec4(0.0);
  for (int k = 0; k < 4; ++k) p += aWeights[k] * nodeTexel(int(aNodes[k]), 0);
  return p;
}
vec3 embedNormal(vec3 n) {
  mat3 c = mat3(0.0);
  for (int k = 0; k < 4; ++k) {
    int node = int(aNodes[k]);
    float w = aWeights[k];
    c[0] += w * nodeTexel(node, 1).xyz;
    c[1] += w * nodeTexel(node, 2).xyz;
    c[2] += w * nodeTexel(node, 3).xyz;
  }
  return c * n;
}
`;

export interface Shared {
  ramp: Texture;
  heldColor: IUniform<Color>;
  /** 0 plain, 1 by value */
  coloring: IUniform<number>;
  /** value of the scale's upper end */
  valueMax: IUniform<number>;
}

export class BodyView {
  readonly group = new Group();
  readonly mesh: Mesh<BufferGeometry, MeshStandardMaterial | MeshLambertMaterial>;
  readonly wire: LineSegments<BufferGeometry, LineBasicMaterial>;
  /** drawn node positions, f32[3N], m */
  readonly nodes: Float32Array;
  private readonly from: Float32Array;
  private readonly to: Float32Array;
  private fromValues: Float32Array | null = null;
  private toValues: Float32Array | null = null;
  private readonly values: Float32Array;
  private readonly field: NodeField;
  private readonly texture: DataTexture;
  private readonly depth: MeshDepthMaterial;
  private surface: Float32Array | null = null;
  /** of each drawn vertex the vertex of the surface */
  private readonly source: ArrayLike<number>;

  constructor(
    readonly body: BodyGeometry,
    color: Color,
    shared: Shared,
    attachments: readonly AttachmentInfo[],
    /** with shine, sheen and coat, which cost time in each pixel */
    rich: boolean,
  ) {
    const count = body.nodes.length / 3;
    this.nodes = body.nodes.slice();
    this.from = body.nodes.slice();
    this.to = body.nodes.slice();
    this.values = new Float32Array(count);
    const texels = Math.max(1, (NODE_FLOATS / 4) * count);
    const width = Math.min(2048, texels);
    const height = Math.ceil(texels / width);
    this.field = new NodeField(body, 4 * width * height);
    this.texture = new DataTexture(this.field.data, width, height, RGBAFormat, FloatType);
    this.texture.minFilter = NearestFilter;
    this.texture.magFilter = NearestFilter;

    const shading = shadingSurface(embedAll(body, body.nodes), body.triangles);
    this.source = shading.source;
    const drawn = shading.source.length;
    const nodes = new Float32Array(4 * drawn);
    const weights = new Float32Array(4 * drawn);
    const held = new Float32Array(drawn);
    const tiedNode = tiedNodes(attachments, count);
    const kinds = TIED_KINDS.length;
    const tied = new Float32Array(kinds * drawn);
    for (let i = 0; i < drawn; ++i) {
      const v = 4 * (shading.source[i] as number);
      let share = 0;
      for (let k = 0; k < 4; ++k) {
        const node = body.vertexNodes[v + k] as number;
        const weight = body.vertexWeights[v + k] as number;
        nodes[4 * i + k] = node;
        weights[4 * i + k] = weight;
        share += weight * (body.held[node] as number);
        for (let c = 0; c < kinds; ++c) {
          tied[kinds * i + c] = (tied[kinds * i + c] as number) + weight * (tiedNode[kinds * node + c] as number);
        }
      }
      held[i] = blended(share);
      for (let c = 0; c < kinds; ++c) tied[kinds * i + c] = blended(tied[kinds * i + c] as number);
    }
    const geometry = new BufferGeometry();
    geometry.setAttribute('position', new BufferAttribute(shading.positions, 3));
    geometry.setAttribute('normal', new BufferAttribute(shading.normals, 3));
    geometry.setAttribute('aNodes', new BufferAttribute(nodes, 4));
    geometry.setAttribute('aWeights', new BufferAttribute(weights, 4));
    geometry.setAttribute('aHeld', new BufferAttribute(held, 1));
    geometry.setAttribute('aTied', new BufferAttribute(tied, kinds));
    geometry.setIndex(new BufferAttribute(shading.triangles, 1));

    const uniforms = {
      uNodes: { value: this.texture },
      uWidth: { value: width },
      uRamp: { value: shared.ramp },
      uHeldColor: shared.heldColor,
      uColoring: body.rigid ? { value: 0 } : shared.coloring,
      uValueMax: shared.valueMax,
    };
    const roughness = body.rigid ? 0.38 : 0.5;
    const material = !rich
      ? new MeshLambertMaterial({ color })
      : body.rigid
        ? new MeshStandardMaterial({ color, roughness })
        : new MeshPhysicalMaterial({
            color,
            roughness,
            sheen: 0.35,
            sheenRoughness: 0.6,
            sheenColor: color.clone().lerp(new Color('white'), 0.5),
            clearcoat: 0.18,
            clearcoatRoughness: 0.45,
          });
    embedIn(material, uniforms, true);
    this.depth = new MeshDepthMaterial({ depthPacking: RGBADepthPacking });
    embedIn(this.depth, uniforms, false);
    this.mesh = new Mesh(geometry, material);
    this.mesh.customDepthMaterial = this.depth;
    this.mesh.castShadow = true;
    this.mesh.receiveShadow = true;
    this.mesh.frustumCulled = false; // positions are known to the shader only
    this.group.add(this.mesh);

    const lines = new BufferGeometry();
    const position = new BufferAttribute(this.nodes, 3);
    position.setUsage(DynamicDrawUsage);
    lines.setAttribute('position', position);
    lines.setIndex(new BufferAttribute(meshEdges(body.tetrahedra, count), 1));
    this.wire = new LineSegments(lines, new LineBasicMaterial({ transparent: true, opacity: 0.55, depthTest: true }));
    this.wire.frustumCulled = false;
    this.wire.visible = false;
    this.group.add(this.wire);
    this.mix(1);
  }

  /** The next state; drawing goes from what is drawn now to it. */
  aim(nodes: Float32Array, values: Float32Array | null): void {
    this.from.set(this.nodes);
    this.to.set(nodes);
    this.fromValues = this.toValues ? this.values.slice() : null;
    this.toValues = values;
  }

  /** Both ends at once, for replay. */
  between(from: Float32Array, to: Float32Array, fromValues: Float32Array | null, toValues: Float32Array | null): void {
    this.from.set(from);
    this.to.set(to);
    this.fromValues = fromValues;
    this.toValues = toValues;
  }

  /** Draws the state at share t of the way, 0 to 1. */
  mix(t: number): void {
    const { nodes, from, to, values, fromValues, toValues } = this;
    for (let i = 0; i < nodes.length; ++i) {
      const a = from[i] as number;
      nodes[i] = a + t * ((to[i] as number) - a);
    }
    if (toValues) {
      for (let i = 0; i < values.length; ++i) {
        const a = fromValues ? (fromValues[i] as number) : (toValues[i] as number);
        values[i] = a + t * ((toValues[i] as number) - a);
      }
    }
    this.field.update(nodes, toValues ? values : null);
    this.texture.needsUpdate = true;
    if (this.wire.visible) (this.wire.geometry.getAttribute('position') as BufferAttribute).needsUpdate = true;
    this.surface = null;
  }

  /** Newest node positions received, f32[3N]. */
  get newest(): Float32Array {
    return this.to;
  }

  showWire(on: boolean): void {
    this.wire.visible = on;
    (this.wire.geometry.getAttribute('position') as BufferAttribute).needsUpdate = true;
  }

  /** Draws vertices of the surface in the color of the handle, in place of what is attached. */
  mark(marked: ArrayLike<number>): void {
    const held = this.mesh.geometry.getAttribute('aHeld') as BufferAttribute;
    for (let i = 0; i < this.source.length; ++i) held.setX(i, marked[this.source[i] as number] as number);
    held.needsUpdate = true;
  }

  /** Surface as drawn, f32[3V]; made when asked for (picking). */
  vertices(): Float32Array {
    this.surface ??= embedAll(this.body, this.nodes);
    return this.surface;
  }

  dispose(): void {
    this.mesh.geometry.dispose();
    this.mesh.material.dispose();
    this.depth.dispose();
    this.texture.dispose();
    this.wire.geometry.dispose();
    this.wire.material.dispose();
  }
}

/** Makes a material of three.js place vertices by the nodes' texture. */
function embedIn(material: Material, uniforms: Record<string, IUniform>, shaded: boolean): void {
  material.onBeforeCompile = (shader) => {
    Object.assign(shader.uniforms, uniforms);
    let vertex = shader.vertexShader.replace('#include <common>', `#include <common>\n${SHADER_HEAD}`);
    if (shaded) {
      vertex = vertex.replace('#include <beginnormal_vertex>', 'vec3 objectNormal = embedNormal(normal);');
    }
    vertex = vertex.replace(
      '#include <begin_vertex>',
      'vec4 embedded = embedPosition();\nvec3 transformed = embedded.xyz;\nvHeld = aHeld;\nvTied = aTied;\nvValue = embedded.w;',
    );
    shader.vertexShader = vertex;
    if (!shaded) return;
    shader.fragmentShader = shader.fragmentShader
      .replace(
        '#include <common>',
        /* glsl */ `#include <common>
varying float vHeld;
varying vec3 vTied;
varying float vValue;
uniform sampler2D uRamp;
uniform vec3 uHeldColor;
uniform float uColoring;
uniform float uValueMax;`,
      )
      .replace(
        '#include <color_fragment>',
        /* glsl */ `#include <color_fragment>
diffuseColor.rgb = mix(diffuseColor.rgb, vec3(0.10, 0.11, 0.13), 0.55 * vTied.x); // fixed
diffuseColor.rgb = mix(diffuseColor.rgb, vec3(0.10, 0.25, 0.55), 0.45 * vTied.y); // springs
diffuseColor.rgb = mix(diffuseColor.rgb, vec3(0.85, 0.75, 0.45), 0.55 * vTied.z); // glued
diffuseColor.rgb = mix(diffuseColor.rgb, uHeldColor, vHeld);
if (uColoring > 0.5) {
  float t = clamp(vValue / max(uValueMax, 1e-12), 0.0, 1.0);
  diffuseColor.rgb = texture2D(uRamp, vec2((t * 255.0 + 0.5) / 256.0, 0.5)).rgb;
}`,
      )
      .replace(
        '#include <emissivemap_fragment>',
        // So that shade does not pass for a low value.
        /* glsl */ `if (uColoring > 0.5) totalEmissiveRadiance += 0.3 * diffuseColor.rgb;`,
      );
  };
  material.customProgramCacheKey = () => `embedded ${shaded} ${material.type}`;
}

/** u32 pairs: each edge of the tetrahedra once. */
function meshEdges(tetrahedra: Uint32Array, nodes: number): Uint32Array {
  const seen = new Set<number>();
  const edges: number[] = [];
  for (let e = 0; e < tetrahedra.length; e += 4) {
    for (let i = 0; i < 4; ++i) {
      for (let j = i + 1; j < 4; ++j) {
        const a = tetrahedra[e + i] as number;
        const b = tetrahedra[e + j] as number;
        const key = Math.min(a, b) * nodes + Math.max(a, b);
        if (seen.has(key)) continue;
        seen.add(key);
        edges.push(a, b);
      }
    }
  }
  return Uint32Array.from(edges);
}
