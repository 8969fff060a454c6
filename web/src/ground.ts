// A plane: a fine grid that fades out, and shadows.
import { Color, DoubleSide, Group, Mesh, PlaneGeometry, Quaternion, ShaderMaterial, ShadowMaterial, Vector3 } from 'three';
import type { Vec3 } from './protocol.ts';

/** Grid spacing: 1, 2 or 5 times a power of ten, m. */
export function gridSpacing(radius: number): number {
  const wanted = radius / 4;
  const power = 10 ** Math.floor(Math.log10(wanted));
  return [1, 2, 5, 10].map((f) => f * power).find((s) => s >= wanted) ?? 10 * power;
}

export class Ground {
  readonly group = new Group();
  private readonly grid: ShaderMaterial;
  private readonly shadow: ShadowMaterial;

  /** @param fade radii at which the grid has faded to a third */
  constructor(point: Vec3, normal: Vec3, center: Vector3, radius: number, fade: number) {
    const n = new Vector3().fromArray(normal).normalize();
    const size = radius * fade * 4.8;
    const geometry = new PlaneGeometry(size, size);
    this.grid = new ShaderMaterial({
      transparent: true,
      depthWrite: false,
      side: DoubleSide,
      uniforms: {
        uColor: { value: new Color() },
        uSpacing: { value: gridSpacing(radius) },
        uFade: { value: radius * fade },
        uOpacity: { value: 1 },
      },
      vertexShader: /* glsl */ `
        varying vec2 vPlane;
        void main() {
          vPlane = position.xy;
          gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
        }`,
      fragmentShader: /* glsl */ `
        varying vec2 vPlane;
        uniform vec3 uColor;
        uniform float uSpacing, uFade, uOpacity;
        float lines(float spacing, float width) {
          vec2 x = vPlane / spacing;
          vec2 w = fwidth(x);
          vec2 d = abs(fract(x - 0.5) - 0.5);
          vec2 a = 1.0 - smoothstep(w * (width - 0.5), w * (width + 0.5), d);
          a *= clamp(1.0 - w * 3.0, 0.0, 1.0); // too fine to be seen: gone rather than noise
          return max(a.x, a.y);
        }
        void main() {
          float d = length(vPlane) / uFade;
          float a = max(0.45 * lines(uSpacing, 0.5), 0.9 * lines(5.0 * uSpacing, 0.6)) * exp(-d * d) * uOpacity;
          if (a < 0.004) discard;
          gl_FragColor = vec4(uColor, a);
          #include <colorspace_fragment>
        }`,
    });
    this.shadow = new ShadowMaterial({ opacity: 0.3, depthWrite: false });
    const shadow = new Mesh(new PlaneGeometry(6 * radius, 6 * radius), this.shadow);
    shadow.receiveShadow = true;
    shadow.renderOrder = -2;
    const grid = new Mesh(geometry, this.grid);
    grid.renderOrder = -1;
    this.group.add(shadow, grid);
    this.group.quaternion.copy(new Quaternion().setFromUnitVectors(new Vector3(0, 0, 1), n));
    // Centered below the scene, on a line of the grid.
    const foot = center.clone().sub(new Vector3().fromArray(point));
    foot.addScaledVector(n, -foot.dot(n));
    this.group.position.fromArray(point);
    const local = foot.applyQuaternion(this.group.quaternion.clone().invert());
    const s = 5 * gridSpacing(radius);
    local.set(Math.round(local.x / s) * s, Math.round(local.y / s) * s, 0);
    this.group.position.add(local.applyQuaternion(this.group.quaternion));
  }

  colors(line: Color, opacity: number, shadow: number): void {
    (this.grid.uniforms['uColor'] as { value: Color }).value.copy(line);
    (this.grid.uniforms['uOpacity'] as { value: number }).value = opacity;
    this.shadow.opacity = shadow;
  }

  dispose(): void {
    for (const child of this.group.children) (child as Mesh).geometry.dispose();
    this.grid.dispose();
    this.shadow.dispose();
  }
}
