// The picture: bodies, ground, light, arrows; what lies under the pointer.
import {
  AmbientLight,
  Box3,
  BoxGeometry,
  BufferAttribute,
  BufferGeometry,
  Color,
  DataTexture,
  DirectionalLight,
  EdgesGeometry,
  Group,
  HemisphereLight,
  Line,
  LineBasicMaterial,
  LineSegments,
  LinearFilter,
  Mesh,
  MeshLambertMaterial,
  NeutralToneMapping,
  PCFShadowMap,
  Raycaster,
  SRGBColorSpace,
  Scene,
  VSMShadowMap,
  Vector2,
  Vector3,
  WebGLRenderer,
} from 'three';
import { toolIsTied } from './attached.ts';
import { BodyView, type Shared } from './body.ts';
import { OrbitCamera } from './camera.ts';
import { castRay, shadingSurface } from './embedding.ts';
import { Ground } from './ground.ts';
import { Arrow, Contacts, Ring, makeTriad, place, placeFrom, poseBetween, setSegment } from './markers.ts';
import type { Frame, Geometry, Pose, SceneInfo, Vec3 } from './protocol.ts';
import { rampTexels } from './ramp.ts';
import { displacement } from './rigid_fit.ts';

export type Coloring = 'plain' | 'stress' | 'displacement';

export interface Shown {
  frames: boolean;
  arrows: boolean;
  contacts: boolean;
  mesh: boolean;
  color: Coloring;
}

export interface Pick {
  /** index of the body hit, or -1 for an obstacle */
  body: number;
  tool: boolean;
  /** m, world */
  point: Vector3;
  distance: number;
}

/** Pixels of the picture for one of the page at most, by quality; the two lowest are for processors. */
const PIXEL_RATIOS = [0.5, 0.75, 1, 1.5, 2];

const TOOL_COLOR = '#f0c592';
const SOFT_COLORS = ['#86b0b4', '#a9b58a', '#b39bc0', '#9fb0cc'];
const RIGID_COLOR = '#a3acb6';
const OBSTACLE_COLOR = '#b9c0c8';
const HELD_COLOR = '#e04a3f';
const FORCE_COLOR = '#2f6fed';
const TORQUE_COLOR = '#9a4fd0';

/** 1, 2 or 5 times a power of ten, at least `value`. */
export function niceAbove(value: number): number {
  if (!(value > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(value));
  return ([1, 2, 5].find((f) => f * power >= value) ?? 10) * power;
}

/** Whether WebGL runs on a processor here: then pictures are made with less. */
function drawnByProcessor(): boolean {
  const probe = document.createElement('canvas').getContext('webgl2');
  if (!probe) return false;
  const names = probe.getExtension('WEBGL_debug_renderer_info');
  const name = String(probe.getParameter(names ? names.UNMASKED_RENDERER_WEBGL : probe.RENDERER));
  probe.getExtension('WEBGL_lose_context')?.loseContext();
  return /swiftshader|llvmpipe|software|basic render/i.test(name);
}

export class View3D {
  readonly orbit = new OrbitCamera();
  readonly renderer: WebGLRenderer;
  readonly shown: Shown = { frames: false, arrows: true, contacts: false, mesh: false, color: 'plain' };
  /** drawn on a processor instead of a graphics card */
  readonly software: boolean;
  bodies: BodyView[] = [];
  /** pictures drawn */
  pictures = 0;
  /** value at the upper end of the color scale: Pa or m */
  valueMax = 1;
  onScale: (max: number) => void = () => {};

  private readonly scene = new Scene();
  private readonly overlay = new Scene();
  private readonly world = new Group();
  private readonly key = new DirectionalLight('#fff4e6', 2.5);
  private readonly rim = new DirectionalLight('#dfe9ff', 0.9);
  private readonly sky = new HemisphereLight('#ffffff', '#b9a999', 1.25);
  private readonly shared: Shared;
  private grounds: Ground[] = [];
  private obstacles: { mesh: Mesh<BufferGeometry, MeshLambertMaterial>; vertices: Float32Array; triangles: Uint32Array }[] = [];
  private readonly force = new Arrow(new Color(FORCE_COLOR));
  private readonly torque = new Ring(new Color(TORQUE_COLOR));
  private readonly contacts = new Contacts();
  private deviceTriad = new Group();
  private proxyTriad = new Group();
  private readonly link: Line<BufferGeometry, LineBasicMaterial>;
  private readonly forceTag: HTMLElement;
  private readonly torqueTag: HTMLElement;
  private info: SceneInfo | null = null;
  private radius = 0.2;
  private center = new Vector3();
  private dirty = true;
  private last = 0;
  private newestAt = 0;
  private interval = 33;
  private mixing = false;
  private wrench = new Float32Array(6);
  private drawnWrench = new Float32Array(6);
  private device: Pose = { position: [0, 0, 0], rotation: [1, 0, 0, 0] };
  private proxy: Pose = this.device;
  /** of the nodes that drawing glides from and to, and as drawn */
  private handleFrom: Pose = this.device;
  private handleTo: Pose = this.device;
  private handle: Pose = this.device;
  private atProxy = false;
  private tied = false;
  private placing: Pose | null = null;
  private readonly box = new LineSegments(
    new EdgesGeometry(new BoxGeometry(1, 1, 1)),
    new LineBasicMaterial({ color: HELD_COLOR, depthTest: false, transparent: true }),
  );
  private fits: Float64Array[] = [];
  private dark = false;
  private width = 1;
  private height = 1;
  private quality = PIXEL_RATIOS.length - 1;
  private slow = 0;
  private readonly heldCenter = new Vector3();

  constructor(
    readonly canvas: HTMLCanvasElement,
    private readonly tags: HTMLElement,
  ) {
    this.software = drawnByProcessor();
    const antialias = !this.software;
    this.renderer = new WebGLRenderer({ canvas, antialias, alpha: true, powerPreference: 'high-performance' });
    if (this.software) this.quality = 1;
    this.renderer.debug.checkShaderErrors = false; // asking for errors waits for each shader in turn
    this.renderer.outputColorSpace = SRGBColorSpace;
    this.renderer.toneMapping = NeutralToneMapping;
    this.renderer.toneMappingExposure = 1.12;
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = this.software ? PCFShadowMap : VSMShadowMap;
    this.renderer.setClearColor(0x000000, 0);
    this.renderer.autoClear = false;

    const ramp = new DataTexture(rampTexels(256), 256, 1);
    ramp.colorSpace = SRGBColorSpace;
    ramp.magFilter = ramp.minFilter = LinearFilter;
    ramp.needsUpdate = true;
    this.shared = {
      ramp,
      heldColor: { value: new Color(HELD_COLOR) },
      coloring: { value: 0 },
      valueMax: { value: 1 },
    };

    this.key.castShadow = true;
    this.scene.add(this.world, this.sky, this.key, this.key.target, this.rim);
    const front = new DirectionalLight('#ffffff', 2);
    front.position.set(1, -2, 3);
    this.overlay.add(new AmbientLight('#ffffff', 1.2), front);
    const segment = new BufferGeometry();
    segment.setAttribute('position', new BufferAttribute(new Float32Array(6), 3));
    this.link = new Line(segment, new LineBasicMaterial({ color: '#8b949e' }));
    this.link.frustumCulled = false;
    this.overlay.add(this.force.group, this.torque.group, this.contacts.group, this.link);
    this.forceTag = this.tag('force');
    this.torqueTag = this.tag('torque');
    this.force.group.visible = this.torque.group.visible = false;
  }

  private tag(kind: string): HTMLElement {
    const tag = document.createElement('div');
    tag.className = `tag ${kind}`;
    tag.hidden = true;
    this.tags.append(tag);
    return tag;
  }

  setTheme(dark: boolean): void {
    this.dark = dark;
    this.sky.intensity = dark ? 1.7 : 2.3;
    this.sky.groundColor.set(dark ? '#6b6058' : '#c4b6a8');
    this.key.intensity = dark ? 1.9 : 1.8;
    this.rim.intensity = dark ? 1.5 : 0.7;
    this.colorGround();
    this.invalidate();
  }

  private colorGround(): void {
    for (const ground of this.grounds) {
      ground.colors(new Color(this.dark ? '#8f9aa6' : '#6f7781'), this.dark ? 0.5 : 0.62, this.dark ? 0.62 : 0.3);
    }
    for (const { wire } of this.bodies) wire.material.color.set(this.dark ? '#d9e2ec' : '#2b323a');
  }

  invalidate(): void {
    this.dirty = true;
  }

  resize(width: number, height: number): void {
    if (width < 1 || height < 1) return;
    this.width = width;
    this.height = height;
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, PIXEL_RATIOS[this.quality] ?? 1));
    this.renderer.setSize(width, height, false);
    this.orbit.resize(width, height);
    this.invalidate();
  }

  // --- scene ----------------------------------------------------------------------------------------------------------

  setScene(info: SceneInfo, geometry: Geometry, keepCamera: boolean): void {
    this.clear();
    this.info = info;
    this.tied = toolIsTied(info.bodies);
    let softs = 0;
    geometry.bodies.forEach((body, index) => {
      const color = body.tool ? TOOL_COLOR : body.rigid ? RIGID_COLOR : SOFT_COLORS[softs++ % SOFT_COLORS.length];
      const view = new BodyView(body, new Color(color), this.shared, info.bodies[index]?.attachments ?? [], !this.software);
      view.showWire(this.shown.mesh && !body.rigid);
      this.bodies.push(view);
      this.fits.push(Float64Array.of(1, 0, 0, 0));
      this.world.add(view.group);
    });
    const box = new Box3();
    for (const view of this.bodies) box.union(new Box3().setFromArray(view.vertices()));
    if (box.isEmpty()) box.set(new Vector3(-0.1, -0.1, 0), new Vector3(0.1, 0.1, 0.2));
    const extent = box.getSize(new Vector3()).length() / 2;
    for (const obstacle of geometry.obstacles) {
      if (obstacle.shape !== 'surface') continue;
      const around = new Box3().setFromArray(obstacle.vertices);
      if (around.getSize(new Vector3()).length() / 2 < 2.5 * extent) box.union(around);
    }
    this.center = box.getCenter(new Vector3());
    this.radius = Math.max(1e-3, box.getSize(new Vector3()).length() / 2);
    for (const obstacle of geometry.obstacles) {
      if (obstacle.shape === 'plane') {
        const ground = new Ground(obstacle.point, obstacle.normal, this.center, this.radius, this.software ? 3 : 5);
        this.grounds.push(ground);
        this.world.add(ground.group);
      } else {
        this.addObstacle(obstacle.vertices, obstacle.triangles);
      }
    }
    this.light();
    const triad = this.radius * 0.28;
    this.overlay.remove(this.deviceTriad, this.proxyTriad);
    this.deviceTriad = makeTriad(triad, false);
    this.proxyTriad = makeTriad(triad * 0.8, true);
    this.overlay.add(this.deviceTriad, this.proxyTriad);
    this.device = this.proxy = this.handleFrom = this.handleTo = this.handle = info.start;
    this.wrench.fill(0);
    this.drawnWrench.fill(0);
    this.contacts.set(new Float32Array(0), 1);
    this.valueMax = this.shared.valueMax.value = 1e-9;
    this.colorGround();
    this.updateHeldCenter();
    // Room above for the arrow.
    if (!keepCamera) this.orbit.frame(this.center, this.radius * 1.12);
    this.setShown({});
    this.invalidate();
  }

  private addObstacle(vertices: Float32Array, triangles: Uint32Array): void {
    const shading = shadingSurface(vertices, triangles, 40);
    const geometry = new BufferGeometry();
    geometry.setAttribute('position', new BufferAttribute(shading.positions, 3));
    geometry.setAttribute('normal', new BufferAttribute(shading.normals, 3));
    geometry.setIndex(new BufferAttribute(shading.triangles, 1));
    const mesh = new Mesh(geometry, new MeshLambertMaterial({ color: OBSTACLE_COLOR }));
    mesh.castShadow = mesh.receiveShadow = true;
    this.obstacles.push({ mesh, vertices, triangles });
    this.world.add(mesh);
  }

  private light(): void {
    const { key, radius: r, center } = this;
    key.position.copy(center).add(new Vector3(-0.9, -1.5, 3.2).multiplyScalar(r * 1.4));
    key.target.position.copy(center);
    this.rim.position.copy(center).add(new Vector3(2, 2.6, 1.2).multiplyScalar(r));
    const shadow = key.shadow;
    const size = this.software ? 512 : 1024;
    shadow.mapSize.set(size, size);
    const camera = shadow.camera;
    camera.left = camera.bottom = -2.1 * r;
    camera.right = camera.top = 2.1 * r;
    camera.near = 0.5 * r;
    camera.far = 10 * r;
    camera.updateProjectionMatrix();
    shadow.bias = this.software ? -0.002 : -0.0004;
    shadow.normalBias = r * 0.012;
    shadow.radius = this.software ? 2.5 : 7;
    shadow.blurSamples = 14;
    shadow.map?.dispose();
    shadow.map = null;
  }

  private clear(): void {
    for (const view of this.bodies) {
      this.world.remove(view.group);
      view.dispose();
    }
    for (const ground of this.grounds) {
      this.world.remove(ground.group);
      ground.dispose();
    }
    for (const { mesh } of this.obstacles) {
      this.world.remove(mesh);
      mesh.geometry.dispose();
      mesh.material.dispose();
    }
    this.bodies = [];
    this.grounds = [];
    this.obstacles = [];
    this.fits = [];
  }

  setShown(change: Partial<Shown>): void {
    Object.assign(this.shown, change);
    const { frames, contacts, mesh, color } = this.shown;
    this.deviceTriad.visible = this.proxyTriad.visible = this.link.visible = frames;
    this.contacts.group.visible = contacts;
    for (const view of this.bodies) view.showWire(mesh && !view.body.rigid);
    this.shared.coloring.value = color === 'plain' ? 0 : 1;
    if (change.color) this.valueMax = this.shared.valueMax.value = 1e-9;
    this.invalidate();
  }

  // --- state ----------------------------------------------------------------------------------------------------------

  /** A frame of a run: drawing glides to its nodes over the time that the last two lay apart. */
  setFrame(frame: Frame, now: number): void {
    this.device = frame.device;
    this.proxy = frame.proxy;
    this.wrench.set(frame.wrench);
    if (frame.nodes.length > 0) {
      const since = now - this.newestAt;
      if (since < 1000) this.interval += 0.25 * (Math.min(400, Math.max(12, since)) - this.interval);
      this.newestAt = now;
      this.handleFrom = this.handle;
      this.handleTo = frame.handle;
      let at = 0;
      this.bodies.forEach((view, b) => {
        const length = view.nodes.length;
        const nodes = frame.nodes.subarray(at, at + length);
        if (nodes.length === length) view.aim(nodes, this.valuesOf(b, nodes, frame.stress, at / 3));
        at += length;
      });
      this.contacts.set(frame.contacts, this.radius * 0.018);
      this.mixing = true;
    }
    this.invalidate();
  }

  /** A state between two recorded frames. */
  setBetween(a: Frame, b: Frame, t: number, wrench: Float32Array): void {
    this.device = poseBetween(a.device, b.device, t);
    this.proxy = poseBetween(a.proxy, b.proxy, t);
    this.handle = poseBetween(a.handle, b.handle, t);
    this.wrench.set(wrench);
    this.drawnWrench.set(wrench);
    let at = 0;
    this.bodies.forEach((view, i) => {
      const length = view.nodes.length;
      const from = a.nodes.subarray(at, at + length);
      const to = b.nodes.subarray(at, at + length);
      if (from.length === length && to.length === length) {
        view.between(from, to, this.valuesOf(i, from, a.stress, at / 3), this.valuesOf(i, to, b.stress, at / 3));
        view.mix(t);
      }
      at += length;
    });
    this.contacts.set(t < 0.5 ? a.contacts : b.contacts, this.radius * 0.018);
    this.mixing = false;
    this.placeTool();
    this.invalidate();
  }

  /**
   * Whether the tool is drawn where the haptic loop has it by now: moved as one rigid body from the handle of its nodes,
   * which are up to two visual steps old, to the proxy.
   */
  setAtProxy(on: boolean): void {
    this.atProxy = on;
  }

  /** Where the tool is drawn while it is being placed, against its rest coordinates; null: where the program has it. */
  setPlacing(pose: Pose | null): void {
    this.placing = pose;
    if (!pose) this.setBox(null);
    this.invalidate();
  }

  /** A box around a part of the tool, rest coordinates, m. */
  setBox(box: { min: Vec3; max: Vec3 } | null): void {
    this.box.removeFromParent();
    if (box) {
      const [min, max] = [new Vector3().fromArray(box.min), new Vector3().fromArray(box.max)];
      this.box.position.copy(min).add(max).multiplyScalar(0.5);
      this.box.scale.copy(max.sub(min)).max(new Vector3(1e-9, 1e-9, 1e-9));
      this.toolView?.group.add(this.box);
    }
    this.invalidate();
  }

  get toolView(): BodyView | undefined {
    return this.bodies.find((view) => view.body.tool);
  }

  private placeTool(): void {
    for (const { body, group } of this.bodies) {
      if (!body.tool) continue;
      if (this.placing) place(group, this.placing);
      else if (this.atProxy && !this.tied) placeFrom(group, this.handle, this.proxy);
      else placeFrom(group, this.proxy, this.proxy);
    }
    this.updateHeldCenter();
  }

  private valuesOf(body: number, nodes: Float32Array, stress: Float32Array, from: number): Float32Array | null {
    const view = this.bodies[body];
    if (!view || this.shown.color === 'plain' || view.body.rigid) return null;
    const count = nodes.length / 3;
    let values: Float32Array;
    if (this.shown.color === 'stress') {
      if (stress.length < from + count) return null;
      values = stress.subarray(from, from + count);
    } else {
      values = new Float32Array(count);
      const weights = view.body.tool ? view.body.held : null;
      displacement(view.body.nodes, nodes, weights, this.fits[body] as Float64Array, values);
    }
    let max = 0;
    for (const value of values) if (value > max) max = value;
    // The scale follows upwards at once and downwards when much too wide.
    const wanted = niceAbove(Math.max(max, this.shown.color === 'stress' ? 1 : this.radius * 1e-3));
    if (wanted > this.valueMax || this.valueMax > 200 * wanted) {
      this.valueMax = this.shared.valueMax.value = wanted;
      this.onScale(wanted);
    }
    return values;
  }

  private updateHeldCenter(): void {
    const tool = this.bodies.find((view) => view.body.tool);
    if (!tool) {
      this.heldCenter.fromArray(this.device.position);
      return;
    }
    this.heldCenter.set(0, 0, 0);
    let count = 0;
    tool.body.held.forEach((held, i) => {
      if (held < 0.5) return;
      this.heldCenter.x += tool.nodes[3 * i] as number;
      this.heldCenter.y += tool.nodes[3 * i + 1] as number;
      this.heldCenter.z += tool.nodes[3 * i + 2] as number;
      ++count;
    });
    tool.group.updateMatrix();
    if (count > 0) this.heldCenter.divideScalar(count).applyMatrix4(tool.group.matrix);
    else this.heldCenter.fromArray(this.device.position);
  }

  /** Newest pose of the device. */
  get devicePose(): Pose {
    return this.device;
  }

  /** Radius of the scene, m. */
  get sceneRadius(): number {
    return this.radius;
  }

  /** Center of the handle as drawn, m. */
  get handleCenter(): Vector3 {
    return this.heldCenter;
  }

  // --- drawing --------------------------------------------------------------------------------------------------------

  /** Draws if anything has changed; true if it did. */
  render(now: number): boolean {
    const seconds = Math.min(0.1, Math.max(0, (now - this.last) / 1000));
    const gap = now - this.last;
    this.last = now;
    if (this.mixing) {
      const t = Math.min(1, (now - this.newestAt) / this.interval);
      for (const view of this.bodies) view.mix(t);
      this.handle = poseBetween(this.handleFrom, this.handleTo, t);
      this.mixing = t < 1;
      this.dirty = true;
    }
    if (this.dirty) this.placeTool();
    for (let i = 0; i < 6; ++i) {
      const step = (this.wrench[i] as number) - (this.drawnWrench[i] as number);
      if (Math.abs(step) > 1e-4) this.dirty = true;
      this.drawnWrench[i]! += step * (1 - Math.exp(-seconds * 30));
    }
    if (this.orbit.update(seconds, this.heldCenter)) this.dirty = true;
    if (!this.dirty) {
      this.slow = 0;
      return false;
    }
    this.dirty = false;
    this.adapt(gap);
    this.placeMarkers();
    const camera = this.orbit.camera;
    this.renderer.clear();
    this.renderer.render(this.scene, camera);
    this.renderer.clearDepth();
    this.renderer.render(this.overlay, camera);
    ++this.pictures;
    return true;
  }

  /** Fewer pixels where pictures come too slowly. */
  private adapt(gap: number): void {
    const least = this.software ? 0 : 2;
    const slow = this.software ? 100 : 26; // ms
    if (this.quality <= least || gap > 3000) return; // a hidden page draws nothing for long
    this.slow = gap > slow ? this.slow + 1 : Math.max(0, this.slow - 1);
    if (this.slow < (this.software ? 8 : 45)) return;
    this.slow = 0;
    --this.quality;
    this.resize(this.width, this.height);
  }

  private placeMarkers(): void {
    place(this.deviceTriad, this.device);
    place(this.proxyTriad, this.proxy);
    const device = new Vector3().fromArray(this.device.position);
    const proxy = new Vector3().fromArray(this.proxy.position);
    if (this.shown.frames) setSegment(this.link.geometry, device, proxy);
    const on = this.shown.arrows;
    const peak = this.info?.device.peakForce || 3;
    const peakTorque = this.info?.device.peakTorque || 0.2;
    const w = this.drawnWrench;
    const force = new Vector3(w[0], w[1], w[2]);
    const torque = new Vector3(w[3], w[4], w[5]);
    const newtons = force.length();
    const scale = (this.radius * 0.8) / peak;
    this.force.set(this.heldCenter, force.clone().multiplyScalar(scale), this.radius * 0.014);
    this.torque.set(this.heldCenter, torque, torque.length() / peakTorque, this.radius * 0.42);
    this.force.group.visible &&= on;
    this.torque.group.visible &&= on;
    this.label(this.forceTag, this.force.group.visible ? this.force.tip : null, `${newtons.toFixed(2)} N`);
    const mNm = torque.length() * 1000;
    this.label(this.torqueTag, this.torque.group.visible ? this.torque.edge : null, `${mNm.toFixed(0)} mN m`);
  }

  private label(tag: HTMLElement, at: Vector3 | null, text: string): void {
    const screen = at ? this.project(at) : null;
    tag.hidden = !screen;
    if (!screen) return;
    const x = Math.min(Math.max(4, screen.x + 10), this.width - 72);
    const y = Math.min(Math.max(4, screen.y - 26), this.height - 26);
    tag.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)`;
    if (tag.textContent !== text) tag.textContent = text;
  }

  /** Pixels from the canvas's upper left corner, or null behind the camera. */
  project(point: Vector3): { x: number; y: number } | null {
    const p = point.clone().project(this.orbit.camera);
    if (p.z > 1 || !Number.isFinite(p.x + p.y)) return null;
    return { x: ((p.x + 1) / 2) * this.width, y: ((1 - p.y) / 2) * this.height };
  }

  /** What is under a point of the canvas (pixels from its upper left corner). */
  pick(x: number, y: number): Pick | null {
    const caster = new Raycaster();
    caster.setFromCamera(new Vector2((2 * x) / this.width - 1, 1 - (2 * y) / this.height), this.orbit.camera);
    const origin = caster.ray.origin.toArray();
    const direction = caster.ray.direction.toArray();
    let best: Pick | null = null;
    const consider = (body: number, tool: boolean, vertices: Float32Array, triangles: Uint32Array): void => {
      const hit = castRay(vertices, triangles, origin, direction);
      if (!hit || (best && best.distance <= hit.distance)) return;
      best = { body, tool, point: caster.ray.at(hit.distance, new Vector3()), distance: hit.distance };
    };
    this.bodies.forEach((view, b) => {
      let vertices = view.vertices();
      if (view.body.tool) {
        vertices = vertices.slice();
        new BufferAttribute(vertices, 3).applyMatrix4(view.group.matrix);
      }
      consider(b, view.body.tool, vertices, view.body.triangles);
    });
    for (const { vertices, triangles } of this.obstacles) consider(-1, false, vertices, triangles);
    return best;
  }

  /** Where the tool is hit near the middle of its box, pixels from the canvas's upper left corner. */
  frontOfTool(): { x: number; y: number } | null {
    const tool = this.toolView;
    if (!tool) return null;
    tool.group.updateMatrix();
    const middle = new Box3().setFromArray(tool.vertices()).getCenter(new Vector3()).applyMatrix4(tool.group.matrix);
    return this.project(middle);
  }

  /** Meters that a pixel is wide at a point. */
  pixelSize(point: Vector3): number {
    const camera = this.orbit.camera;
    const depth = point.clone().sub(camera.position).dot(this.orbit.forward());
    return (2 * Math.max(depth, camera.near) * Math.tan((camera.fov * Math.PI) / 360)) / this.height;
  }

  /** The picture as shown, with background and labels of force, as PNG. */
  picture(background: [string, string]): Promise<Blob> {
    this.invalidate();
    this.render(performance.now());
    const out = document.createElement('canvas');
    out.width = this.canvas.width;
    out.height = this.canvas.height;
    const context = out.getContext('2d');
    if (!context) return Promise.reject(new Error('no picture can be made'));
    const { width: w, height: h } = out;
    const gradient = context.createRadialGradient(w / 2, h * 0.3, 0, w / 2, h * 0.3, Math.max(w, h));
    gradient.addColorStop(0, background[0]);
    gradient.addColorStop(1, background[1]);
    context.fillStyle = gradient;
    context.fillRect(0, 0, w, h);
    context.drawImage(this.canvas, 0, 0);
    return new Promise((resolve, reject) =>
      out.toBlob((blob) => (blob ? resolve(blob) : reject(new Error('no picture can be made'))), 'image/png'),
    );
  }
}
