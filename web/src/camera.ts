// Orbiting camera, z up: angles and distance glide to where they are aimed.
import { PerspectiveCamera, Vector3 } from 'three';

const DEGREE = Math.PI / 180;
const HOME = { azimuth: -62 * DEGREE, elevation: 17 * DEGREE };

export class OrbitCamera {
  readonly camera = new PerspectiveCamera(32, 1, 0.01, 100);
  /** what the camera looks at while it follows nothing, m */
  private readonly target = new Vector3();
  private readonly aimTarget = new Vector3();
  private readonly home = new Vector3();
  private readonly followed = new Vector3();
  private azimuth = HOME.azimuth;
  private elevation = HOME.elevation;
  private distance = 1;
  private aim = { ...HOME, distance: 1 };
  private radius = 1;
  private moving = true;
  following = false;

  constructor() {
    this.camera.up.set(0, 0, 1);
  }

  /** A new scene: sphere to have in sight, m. Keeps the angles. */
  frame(center: Vector3, radius: number): void {
    this.radius = radius;
    this.home.copy(center);
    this.camera.near = radius * 0.02;
    this.camera.far = radius * 120;
    this.reset();
    this.azimuth = this.aim.azimuth;
    this.elevation = this.aim.elevation;
    this.distance = this.aim.distance;
    this.target.copy(this.aimTarget);
  }

  reset(): void {
    this.aim = { ...HOME, distance: this.fitting() };
    this.aimTarget.copy(this.home);
    this.moving = true;
  }

  private fitting(): number {
    const half = (this.camera.fov * DEGREE) / 2;
    const side = Math.atan(Math.tan(half) * this.camera.aspect);
    return (1.12 * this.radius) / Math.sin(Math.min(half, side));
  }

  resize(width: number, height: number): void {
    const before = this.fitting();
    this.camera.aspect = width / Math.max(1, height);
    const ratio = this.fitting() / before;
    this.aim.distance *= ratio;
    this.distance *= ratio;
    this.moving = true;
  }

  orbit(dx: number, dy: number): void {
    this.aim.azimuth -= dx;
    this.aim.elevation = Math.min(89 * DEGREE, Math.max(-25 * DEGREE, this.aim.elevation + dy));
    this.moving = true;
  }

  /** Moves the target in the picture's plane by a share of the picture's height. */
  pan(dx: number, dy: number): void {
    const scale = 2 * this.distance * Math.tan((this.camera.fov * DEGREE) / 2);
    this.aimTarget.addScaledVector(this.right(), -dx * scale).addScaledVector(this.up(), dy * scale);
    this.moving = true;
  }

  zoom(factor: number): void {
    this.aim.distance = Math.min(this.radius * 40, Math.max(this.radius * 0.4, this.aim.distance * factor));
    this.moving = true;
  }

  follow(on: boolean): void {
    this.following = on;
    this.moving = true;
  }

  right(): Vector3 {
    return new Vector3().setFromMatrixColumn(this.camera.matrixWorld, 0);
  }

  up(): Vector3 {
    return new Vector3().setFromMatrixColumn(this.camera.matrixWorld, 1);
  }

  forward(): Vector3 {
    return new Vector3().setFromMatrixColumn(this.camera.matrixWorld, 2).negate();
  }

  /** One picture later; true if the camera has moved. `tool` is what to follow. */
  update(seconds: number, tool: Vector3): boolean {
    const share = 1 - Math.exp(-seconds * 14);
    if (this.following) {
      const drift = tool.clone().sub(this.followed);
      if (drift.length() > this.radius * 1e-4) {
        this.aimTarget.add(drift);
        this.moving = true;
      }
    }
    this.followed.copy(tool);
    if (!this.moving) return false;
    const near = (a: number, b: number): boolean => Math.abs(a - b) < 1e-5;
    this.azimuth += share * (this.aim.azimuth - this.azimuth);
    this.elevation += share * (this.aim.elevation - this.elevation);
    this.distance += share * (this.aim.distance - this.distance);
    this.target.lerp(this.aimTarget, share);
    if (
      near(this.azimuth, this.aim.azimuth) &&
      near(this.elevation, this.aim.elevation) &&
      near(this.distance / this.aim.distance, 1) &&
      this.target.distanceTo(this.aimTarget) < this.radius * 1e-5
    ) {
      this.moving = false;
    }
    const c = Math.cos(this.elevation);
    this.camera.position
      .set(Math.cos(this.azimuth) * c, Math.sin(this.azimuth) * c, Math.sin(this.elevation))
      .multiplyScalar(this.distance)
      .add(this.target);
    this.camera.lookAt(this.target);
    this.camera.updateProjectionMatrix();
    this.camera.updateMatrixWorld();
    return true;
  }
}
