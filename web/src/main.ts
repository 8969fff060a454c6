// Puts the page together: messages in, pictures and plots out, controls to commands.
import { Connection, type Link } from './connection.ts';
import {
  button,
  byId,
  download,
  element,
  fillSelect,
  input,
  onChoice,
  onPress,
  remember,
  remembered,
  select,
  setIcon,
  setPressed,
  setText,
} from './dom.ts';
import { Hand } from './hand.ts';
import { Panel, Slider } from './panel.ts';
import { Placing } from './placing.ts';
import { forgetColors } from './plots.ts';
import {
  PROTOCOL_VERSION,
  decodeSession,
  type BinaryMessage,
  type Command,
  type Frame,
  type Geometry,
  type RunState,
  type SceneInfo,
  type Session,
  type Settings,
  type Stats,
  type TextMessage,
} from './protocol.ts';
import { rampColor } from './ramp.ts';
import { Replay } from './replay.ts';
import { RunHistory, TICKS, stepTable, tickTable } from './run_history.ts';
import { ThemeSwitch } from './theme.ts';
import { View3D, type Coloring } from './view3d.ts';

const PLOTS_EVERY = 33; // ms
/** keys that mean nothing while a surface is being placed */
const OF_RUNS = [' ', '.', 'r', 'p', '5'];
const SPEEDS = [0.05, 0.1, 0.25, 0.5, 1];
const REPLAY_SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];
const METHOD_NAMES: Record<string, string> = {
  live: 'live: tool in the tick',
  hsl: 'hsl: linearized',
  'hsl-exact': 'hsl-exact',
  vc: 'vc: virtual coupling',
};

class App {
  private readonly view: View3D;
  private readonly hand: Hand;
  private history = new RunHistory();
  private readonly panel: Panel;
  private readonly placing: Placing;
  private readonly theme: ThemeSwitch;
  private connection: Connection | null = null;
  private session: Session = decodeSession({});
  private replay: Replay | null = null;
  private replayPart = -1;
  private readonly replayWrench = new Float32Array(6);

  private link: Link = 'connecting';
  private retryAt = 0;
  private viewer = 0;
  private scene: SceneInfo | null = null;
  private geometry: Geometry | null = null;
  private state: RunState | null = null;
  private stats: Stats | null = null;
  private generation = -1;
  private sceneShown = '';
  private frame: Frame | null = null;
  private pendingFrame: Frame | null = null;
  private frames = 0;
  private lastSteps = 0;
  private held = false;
  private hintAfter = 0;
  private firstPicture = NaN;
  private lastPlots = 0;
  private lastTick = 0;
  private rates = { at: 0, pictures: 0, ticks: 0, steps: 0 };
  private readonly sliders: Record<'visual_step' | 'friction' | 'stiffness', Slider>;

  constructor() {
    this.view = new View3D(byId('view', HTMLCanvasElement), element('tags'));
    this.hand = new Hand(this.view, (command) => this.send(command));
    this.panel = new Panel(this.history, () => this.state?.visualStep ?? null);
    this.placing = new Placing(
      this.view,
      (placement) => this.send({ type: 'place', ...placement }),
      (text) => this.notice('error', text),
      () => this.send({ type: 'cancel' }),
    );
    this.hand.brush = (x, y, first) => this.placing.paint(x, y, first);
    this.theme = new ThemeSwitch((theme) => {
      forgetColors();
      this.view.setTheme(theme === 'dark');
      this.panel.redrawHistograms();
      this.lastPlots = 0;
    });
    this.theme.apply();
    this.sliders = {
      visual_step: new Slider('visual-step', (p) => p / 1000, (v) => v * 1000, (v) => `${(v * 1000).toFixed(0)} ms`, (v) => this.set({ visual_step: v })),
      friction: new Slider('friction', (p) => p, (v) => v, (v) => `x ${v.toFixed(2)}`, (v) => this.set({ friction: v })),
      stiffness: new Slider('stiffness', (p) => 2 ** p, (v) => Math.log2(Math.max(v, 1e-6)), (v) => `x ${v.toFixed(2)}`, (v) => this.set({ stiffness: v })),
    }; // prettier-ignore
    this.wireControls();
    this.wireKeys();
    this.wireFiles();
    this.expose();
    new ResizeObserver(() => this.resize()).observe(element('stage'));
    this.resize();
    requestAnimationFrame((now) => this.loop(now));
    void this.begin();
  }

  private async begin(): Promise<void> {
    try {
      const response = await fetch('session.json');
      if (response.ok) this.session = decodeSession(await response.json());
    } catch {
      // The socket tells whether the program is there.
    }
    if (this.session.mode === 'replay') {
      await this.fetchReplay();
      return;
    }
    this.connect();
  }

  private connect(): void {
    const url = new URL('ws', location.href);
    url.protocol = url.protocol === 'https:' ? 'wss:' : 'ws:';
    url.search = '';
    url.hash = '';
    this.connection = new Connection(url.href, {
      message: (message) => this.receive(message),
      link: (link, wait) => this.linkChanged(link, wait),
    });
  }

  private send(command: Command): boolean {
    return this.connection?.send(command) ?? false;
  }

  private set(settings: Settings): void {
    this.send({ type: 'set', ...settings });
  }

  // --- messages -------------------------------------------------------------------------------------------------------

  private receive(message: TextMessage | BinaryMessage): void {
    if (this.replay) return; // a recording is open; the run goes on behind it
    switch (message.type) {
      case 'welcome':
        this.viewer = message.viewer;
        if (message.protocol !== PROTOCOL_VERSION) {
          this.notice('error', `The program speaks protocol ${message.protocol}, this page ${PROTOCOL_VERSION}: reload the page.`);
        }
        break;
      case 'scene':
        this.scene = message;
        break;
      case 'geometry':
        this.geometry = message;
        this.showScene();
        break;
      case 'state':
        this.state = message;
        this.showState();
        break;
      case 'stats':
        this.stats = message;
        this.panel.stats(message);
        setText(element('s-missed'), String(message.missed));
        break;
      case 'notice':
        this.notice(message.level, message.text);
        break;
      case 'saved':
        download([message.text], message.name, 'application/yaml');
        break;
      case 'frame':
        if (message.generation === this.generation) this.takeFrame(message);
        break;
      case 'samples':
        if (message.generation === this.generation) this.history.append(message);
        break;
      case 'invalid':
        this.notice('error', `A message could not be read: ${message.reason}.`);
        break;
    }
  }

  /** Only the newest frame is drawn, but nodes must not be lost to a newer frame without them. */
  private takeFrame(frame: Frame): void {
    ++this.frames;
    const before = this.pendingFrame;
    if (before && before.nodes.length > 0 && frame.nodes.length === 0) {
      this.pendingFrame = { ...frame, nodes: before.nodes, stress: before.stress, contacts: before.contacts };
    } else {
      this.pendingFrame = frame;
    }
    if (frame.nodes.length > 0) this.lastSteps = frame.step;
  }

  private showScene(): void {
    const { scene, geometry } = this;
    if (!scene || !geometry || scene.generation !== geometry.generation) return;
    if (this.hand.isHolding) this.hand.letGo();
    this.generation = scene.generation;
    this.history.clear();
    this.panel.time.now();
    this.frame = null;
    this.pendingFrame = null;
    const key = `${scene.name} ${scene.title} ${geometry.bodies.map((b) => b.nodes.length).join()}`;
    this.view.setScene(scene, geometry, key === this.sceneShown);
    this.sceneShown = key;
    this.describe(scene);
    const scenes = scene.scenes.some(({ name }) => name === scene.name)
      ? scene.scenes
      : [{ name: scene.name, description: '' }, ...scene.scenes];
    fillSelect(select('scene'), scenes.map(({ name }) => [name, name]), scene.name);
    this.showState();
  }

  private describe(scene: SceneInfo): void {
    setText(element('title'), scene.title || scene.name);
    const description = scene.description.trim();
    setText(element('description'), description);
    document.title = `${scene.title || scene.name} - Palpate`;
    const sum = (pick: (b: SceneInfo['bodies'][number]) => number): string =>
      scene.bodies.reduce((total, body) => total + pick(body), 0).toLocaleString('en');
    setText(element('s-mesh'), `${sum((b) => b.tetrahedra)} tetrahedra, ${sum((b) => b.triangles)} triangles`);
  }

  private showState(): void {
    const { state, scene } = this;
    if (!state || !scene) return;
    this.view.setAtProxy(state.method === 'live');
    fillSelect(select('handle'), scene.handles.map((h) => [h, h]), state.handle);
    fillSelect(select('method'), scene.methods.map((m) => [m, METHOD_NAMES[m] ?? m]), state.method);
    const speeds = SPEEDS.includes(state.speed) ? SPEEDS : [...SPEEDS, state.speed].sort((a, b) => a - b);
    fillSelect(select('speed'), speeds.map((s) => [String(s), `${s} x`]), String(state.speed));
    this.sliders.visual_step.set(state.visualStep);
    this.sliders.friction.set(state.friction);
    this.sliders.stiffness.set(state.stiffness);
    setIcon(button('pause'), state.paused ? 'play' : 'pause', state.paused ? 'Go on' : 'Pause', `${state.paused ? 'Go on' : 'Pause'} (Space)`);
    button('step').disabled = !state.paused;
    setPressed(button('path'), state.driver === 'path');
    setPressed(button('record'), state.recording !== null);
    button('record').title = state.recording === null ? 'Record' : `Recording to ${state.recording}`;
    const holder = element('holder');
    const mine = state.hand === this.viewer;
    holder.hidden = state.hand === null;
    setText(holder, mine ? 'You hold the tool' : `Viewer ${state.hand} holds the tool`);
    setText(element('s-viewers'), state.viewers > 1 ? `${state.viewers} viewers` : '');
    element('busy').hidden = state.busy === null;
    setText(element('busy-text'), state.busy ?? '');
    this.showPlacing(state);
    element('again').hidden = state.motion === 'none' || state.hand !== null || (state.motion === 'playing' && state.driver === 'path') || state.placing !== null;
    // The server has given the hand to another: letting go here keeps the pictures true.
    if (state.hand !== null && !mine && this.hand.isHolding) this.hand.refused();
  }

  private showPlacing(state: RunState): void {
    if (state.generation !== this.generation) return;
    const before = this.placing.active;
    this.placing.show(state.placing, state.generation);
    const { active } = this.placing;
    if (active === before) return;
    this.hand.enabled = !active;
    document.body.classList.toggle('placing', active);
    if (active && document.body.classList.contains('no-panel')) this.togglePanel();
    element('panel').scrollTop = 0;
    this.resize();
  }

  private playAgain(): void {
    this.send({ type: 'play' });
    if (this.state?.paused) this.send({ type: 'resume' });
  }

  private linkChanged(link: Link, wait: number): void {
    this.link = link;
    this.retryAt = performance.now() + wait * 1000;
    if (link !== 'open') {
      if (this.hand.isHolding) this.hand.refused();
      this.hand.delay = NaN;
    }
    this.showLink();
  }

  private showLink(): void {
    const link = element('link');
    link.dataset['link'] = this.replay ? 'open' : this.link;
    const names: Record<Link, string> = { connecting: 'Connecting', open: 'Connected', lost: 'Lost' };
    setText(element('link-text'), this.replay ? 'Replay' : names[this.link]);
    const lost = this.link === 'lost' && !this.replay;
    element('banner').hidden = !lost;
    if (!lost) return;
    const left = Math.ceil((this.retryAt - performance.now()) / 1000);
    setText(element('banner'), left > 1 ? `Lost the server, trying again in ${left} s` : 'Lost the server, trying again');
  }

  private notice(level: 'info' | 'error', text: string): void {
    const box = element('notices');
    if (box.lastElementChild?.textContent === text) return;
    const item = document.createElement('div');
    item.className = `notice ${level}`;
    item.textContent = text;
    box.append(item);
    while (box.childElementCount > 4) box.firstElementChild?.remove();
    setTimeout(() => item.remove(), level === 'error' ? 10_000 : 5_000);
  }

  // --- replay ---------------------------------------------------------------------------------------------------------

  private async fetchReplay(): Promise<void> {
    element('busy').hidden = false;
    setText(element('busy-text'), 'Loading the recording');
    try {
      const response = await fetch('recording');
      if (!response.ok) throw new Error(`the program answers ${response.status}`);
      this.openReplay(await response.arrayBuffer(), this.session.name, false);
    } catch (error) {
      this.notice('error', `The recording cannot be loaded: ${error instanceof Error ? error.message : String(error)}.`);
    }
    element('busy').hidden = true;
  }

  private openReplay(buffer: ArrayBuffer, name: string, leavable: boolean): void {
    const replay = Replay.read(buffer);
    if (typeof replay === 'string') {
      this.notice('error', `The recording cannot be read: ${replay}.`);
      return;
    }
    if (replay.complaint !== null) this.notice('info', `The recording is shown as far as it goes: ${replay.complaint}.`);
    if (this.hand.isHolding) this.hand.letGo();
    this.replay = replay;
    this.replayPart = -1;
    this.history = replay.history;
    this.panel.show(this.history);
    this.hand.enabled = false;
    document.body.classList.add('replay');
    setText(element('replay-title'), `Replay of ${name}`);
    button('replay-leave').hidden = !leavable;
    const slider = input('replay-time');
    slider.min = (Math.floor(replay.start * 1000) / 1000).toFixed(3);
    slider.max = (Math.ceil(replay.end * 1000) / 1000).toFixed(3);
    this.panel.time.now();
    this.showLink();
    element('holder').hidden = true;
    this.resize();
  }

  private leaveReplay(): void {
    this.replay = null;
    this.hand.enabled = true;
    document.body.classList.remove('replay');
    this.history = new RunHistory();
    this.panel.show(this.history);
    this.generation = -1;
    this.panel.time.cursor = null;
    this.sceneShown = '';
    // The connection has gone on: a new one brings scene, geometry and state again.
    this.connection?.close();
    this.connect();
  }

  private playReplay(seconds: number): void {
    const { replay } = this;
    if (!replay) return;
    const before = replay.time;
    replay.advance(seconds);
    const moment = replay.moment();
    const part = moment ? replay.parts[moment.part] : undefined;
    if (!moment || !part) return;
    if (moment.part !== this.replayPart) {
      this.view.setScene(part.scene, part.geometry, this.replayPart >= 0);
      this.replayPart = moment.part;
      this.scene = part.scene;
      this.state = part.state;
      this.view.setAtProxy(part.state?.method === 'live');
      this.describe(part.scene);
    } else if (before === replay.time && this.frame === moment.a && !this.replayStale) {
      return;
    }
    this.replayStale = false;
    this.frame = moment.a;
    replay.wrench(moment.a, this.replayWrench);
    this.view.setBetween(moment.a, moment.b, moment.t, this.replayWrench);
    ++this.frames;
    this.showContacts(moment.a);
    const slider = input('replay-time');
    slider.value = String(replay.time);
    slider.setAttribute('aria-valuetext', `${replay.time.toFixed(2)} seconds`);
    setText(element('replay-clock'), `${replay.time.toFixed(2)} / ${replay.end.toFixed(2)} s`);
    const icon = replay.playing ? 'pause' : 'play';
    const label = replay.playing ? 'Pause' : 'Play';
    if (button('replay-play').getAttribute('aria-label') !== label) setIcon(button('replay-play'), icon, label, `${label} (Space)`);
    // The plots follow: the present time is marked and in sight.
    const time = this.panel.time;
    time.cursor = replay.time;
    const span = Math.min(time.length, replay.end - replay.start);
    time.hold(Math.min(Math.max(replay.time + 0.3 * span, replay.start + span), replay.end));
  }
  private replayStale = true;

  // --- loop -----------------------------------------------------------------------------------------------------------

  private loop(now: number): void {
    requestAnimationFrame((next) => this.loop(next));
    const seconds = Math.min(0.25, Math.max(0, (now - this.lastTick) / 1000));
    this.lastTick = now;
    if (this.replay) {
      this.playReplay(seconds);
    } else if (this.pendingFrame) {
      this.frame = this.pendingFrame;
      this.pendingFrame = null;
      this.view.setFrame(this.frame, now);
      this.showContacts(this.frame);
    }
    this.hand.tick(seconds, now);
    const drawn = this.view.render(now);
    if (drawn && this.frame) {
      this.hand.drawn(this.frame.handSeq, performance.now());
      if (Number.isNaN(this.firstPicture)) this.firstPicture = performance.now();
    }
    this.connection?.acknowledge();
    if (now - this.lastPlots >= PLOTS_EVERY) {
      this.lastPlots = now;
      if (!document.body.classList.contains('no-panel')) this.panel.draw(now);
      this.showNumbers(now);
    }
    this.placeHint(now);
  }

  private showContacts(frame: Frame): void {
    let active = 0;
    for (let i = 9; i < frame.contacts.length; i += 10) if ((frame.contacts[i] as number) > 0.5) ++active;
    setText(element('s-contacts'), String(active));
  }

  private lastForce(): number {
    const { ticks } = this.history;
    if (this.replay) return Math.hypot(this.replayWrench[0]!, this.replayWrench[1]!, this.replayWrench[2]!);
    return ticks.empty ? 0 : ticks.value(TICKS.sentForce, ticks.length - 1) || 0;
  }

  private showNumbers(now: number): void {
    setText(element('s-force'), this.lastForce().toFixed(2));
    const time = this.replay ? this.replay.time : this.history.ticks.lastTime;
    setText(element('s-time'), `${time.toFixed(2)} s`);
    this.showLink();
    const { rates } = this;
    const since = (now - rates.at) / 1000;
    if (since < 1) return;
    const rate = (after: number, before: number): string => Math.max(0, (after - before) / since).toFixed(0);
    setText(element('s-fps'), rate(this.view.pictures, rates.pictures));
    setText(element('s-ticks'), rate(this.history.received, rates.ticks));
    setText(element('s-steps'), rate(this.lastSteps, rates.steps));
    setText(element('s-delay'), Number.isNaN(this.hand.delay) ? '-' : this.hand.delay.toFixed(0));
    this.rates = { at: now, pictures: this.view.pictures, ticks: this.history.received, steps: this.lastSteps };
  }

  private placeHint(now: number): void {
    const hint = element('hint');
    if (!this.held && this.hintAfter === 0 && this.frame) this.hintAfter = now + 600;
    const red = this.view.shown.color === 'plain';
    const wanted = red && !this.held && !this.replay && !this.placing.active && this.frame !== null && this.state?.hand === null && now > this.hintAfter;
    if (hint.hidden === wanted) hint.hidden = !wanted;
    if (!wanted) return;
    const at = this.view.project(this.view.handleCenter);
    if (!at) return;
    const width = hint.offsetWidth;
    const x = Math.min(Math.max(8, at.x + 46), element('stage').clientWidth - width - 8);
    hint.style.transform = `translate(${x.toFixed(0)}px, ${Math.max(8, at.y - 20).toFixed(0)}px)`;
  }

  private resize(): void {
    const stage = element('stage');
    this.view.resize(stage.clientWidth, stage.clientHeight);
  }

  // --- controls -------------------------------------------------------------------------------------------------------

  private togglePause(): void {
    if (this.replay) {
      this.replay.play(!this.replay.playing);
      this.replayStale = true;
    } else {
      this.send({ type: this.state?.paused ? 'resume' : 'pause' });
    }
  }

  private singleStep(): void {
    if (this.replay) {
      this.replay.stepFrame(true);
      this.replayStale = true;
    } else if (this.state?.paused) {
      this.send({ type: 'step' });
    }
  }

  private setColor(color: Coloring): void {
    this.view.setShown({ color });
    select('color').value = color;
    element('legend').hidden = color === 'plain';
    setText(element('legend-title'), color === 'stress' ? 'Von Mises stress' : 'Displacement in the body');
    this.set({ stress: color === 'stress' });
    this.replayStale = true;
    setText(element('legend-high'), '');
  }

  private toggleShown(what: 'frames' | 'arrows' | 'contacts' | 'mesh'): void {
    this.view.setShown({ [what]: !this.view.shown[what] });
    setPressed(button(`show-${what}`), this.view.shown[what]);
  }

  private togglePanel(): void {
    const hidden = document.body.classList.toggle('no-panel');
    button('toggle-panel').setAttribute('aria-expanded', String(!hidden));
    remember('panel', hidden ? 'hidden' : 'shown');
    this.resize();
  }

  private follow(): void {
    this.view.orbit.follow(!this.view.orbit.following);
    setPressed(button('camera-follow'), this.view.orbit.following);
  }

  private help(): void {
    const dialog = byId('help-dialog', HTMLDialogElement);
    if (dialog.open) dialog.close();
    else dialog.showModal();
  }

  private wireControls(): void {
    this.wireButtons();
    this.wireChoices();
    this.wireSaveMenu();
    this.wireReplay();
    this.drawLegend();
    this.hand.onHold = (holding) => {
      if (holding) this.held = true;
    };
    if (remembered('panel') === 'hidden' || (remembered('panel') === null && window.innerWidth < 560)) this.togglePanel();
  }

  private wireButtons(): void {
    onPress('pause', () => this.togglePause());
    onPress('step', () => this.singleStep());
    onPress('reset', () => this.send({ type: 'reset' }));
    onPress('path', () => this.send({ type: 'play' }));
    onPress('again', () => this.playAgain());
    onPress('record', () => this.send({ type: 'record', on: this.state?.recording == null }));
    onPress('theme', () => this.theme.toggle());
    onPress('help', () => this.help());
    onPress('toggle-panel', () => this.togglePanel());
    onPress('zoom-in', () => this.view.orbit.zoom(1 / 1.25));
    onPress('zoom-out', () => this.view.orbit.zoom(1.25));
    onPress('camera-home', () => this.view.orbit.reset());
    onPress('camera-follow', () => this.follow());
    onPress('now', () => this.panel.time.now());
    for (const what of ['frames', 'arrows', 'contacts', 'mesh'] as const) onPress(`show-${what}`, () => this.toggleShown(what));
  }

  private wireChoices(): void {
    onChoice('scene', (name) => this.send({ type: 'scene', name }));
    onChoice('handle', (handle) => this.set({ handle }));
    onChoice('method', (method) => this.set({ method }));
    onChoice('speed', (speed) => this.set({ speed: Number(speed) }));
    onChoice('color', (color) => this.setColor(color as Coloring));
    onChoice('window', (seconds) => {
      this.panel.time.length = Number(seconds);
      this.replayStale = true;
    });
    this.panel.time.onFollow = (following) => {
      button('now').hidden = following || this.replay !== null;
    };
    this.view.onScale = (max) => {
      const stress = this.view.shown.color === 'stress';
      const text = stress
        ? max >= 1e6 ? `${max / 1e6} MPa` : max >= 1000 ? `${max / 1000} kPa` : `${max} Pa`
        : `${Number((max * 1000).toPrecision(3))} mm`; // prettier-ignore
      setText(element('legend-high'), text);
    };
  }

  private wireSaveMenu(): void {
    const menu = element('save-menu');
    const showMenu = (shown: boolean): void => {
      menu.hidden = !shown;
      button('save').setAttribute('aria-expanded', String(shown));
    };
    onPress('save', () => {
      showMenu(menu.hidden);
      if (!menu.hidden) button('save-picture').focus();
    });
    menu.addEventListener('keydown', (e) => {
      const items = [...menu.querySelectorAll('button')];
      const at = items.indexOf(document.activeElement as HTMLButtonElement);
      if (e.key === 'Escape') {
        showMenu(false);
        button('save').focus();
      } else if (e.key === 'ArrowDown' || e.key === 'ArrowUp') {
        items[(at + (e.key === 'ArrowDown' ? 1 : items.length - 1)) % items.length]?.focus();
        e.preventDefault();
      }
      e.stopPropagation();
    });
    document.addEventListener('pointerdown', (e) => {
      if (e.target instanceof Node && !button('save').parentElement?.contains(e.target)) showMenu(false);
    });
    const save = (id: string, act: () => void): void =>
      onPress(id, () => {
        showMenu(false);
        button('save').focus();
        act();
      });
    const name = (): string => (this.scene?.name || 'run').replace(/[^\w-]+/g, '-');
    save('save-ticks', () => download(tickTable(this.history), `${name()}-ticks.csv`, 'text/csv'));
    save('save-steps', () => download(stepTable(this.history), `${name()}-steps.csv`, 'text/csv'));
    save('save-picture', () => void this.savePicture(name()));
    save('save-scene', () => this.send({ type: 'save' }));
  }

  private wireReplay(): void {
    fillSelect(select('replay-speed'), REPLAY_SPEEDS.map((s) => [String(s), `${s} x`]), '1');
    onChoice('replay-speed', (speed) => {
      if (this.replay) this.replay.speed = Number(speed);
    });
    onPress('replay-play', () => this.togglePause());
    onPress('replay-leave', () => this.leaveReplay());
    input('replay-time').addEventListener('input', () => {
      if (!this.replay) return;
      this.replay.playing = false;
      this.replay.seek(Number(input('replay-time').value));
      this.replayStale = true;
    });
  }

  private async savePicture(name: string): Promise<void> {
    const style = getComputedStyle(document.documentElement);
    try {
      const blob = await this.view.picture([
        style.getPropertyValue('--sky').trim(),
        style.getPropertyValue('--horizon').trim(),
      ]);
      download([blob], `${name}.png`, 'image/png');
    } catch (error) {
      this.notice('error', error instanceof Error ? error.message : String(error));
    }
  }

  private drawLegend(): void {
    const canvas = byId('legend-ramp', HTMLCanvasElement);
    const context = canvas.getContext('2d');
    if (!context) return;
    for (let x = 0; x < canvas.width; ++x) {
      context.fillStyle = `rgb(${rampColor(x / (canvas.width - 1)).join(' ')})`;
      context.fillRect(x, 0, 1, canvas.height);
    }
  }

  private wireKeys(): void {
    // A ring around the whole scene is for those who come by keyboard.
    document.addEventListener('pointerdown', () => document.body.classList.add('pointing'), true);
    document.addEventListener('keydown', () => document.body.classList.remove('pointing'), true);
    const keys = this.keys();
    const ofPlots = ['+', '=', '-']; // a plot that has the focus zooms itself
    document.addEventListener('keydown', (e) => {
      const target = e.target as HTMLElement;
      if (e.ctrlKey || e.metaKey || e.altKey || target.closest('select, input, dialog, [role=menu]')) return;
      if (e.key === ' ' && target.closest('button, summary')) return;
      if (ofPlots.includes(e.key) && target.closest('.plot canvas')) return;
      const act = keys.get(e.key);
      if (!act || (this.placing.active && OF_RUNS.includes(e.key))) return;
      act();
      e.preventDefault();
    });
  }

  /** What each key does, as the help lists them. */
  private keys(): Map<string, () => void> {
    const nearer = (): void => this.view.orbit.zoom(1 / 1.15);
    return new Map<string, () => void>([
      [' ', () => this.togglePause()],
      ['.', () => this.singleStep()],
      [
        ',',
        () => {
          this.replay?.stepFrame(false);
          this.replayStale = true;
        },
      ],
      ['r', () => !this.replay && this.send({ type: 'reset' })],
      ['p', () => !this.replay && this.send({ type: 'play' })],
      ['f', () => this.follow()],
      ['0', () => this.view.orbit.reset()],
      ['+', nearer],
      ['=', nearer],
      ['-', () => this.view.orbit.zoom(1.15)],
      ['1', () => this.toggleShown('frames')],
      ['2', () => this.toggleShown('arrows')],
      ['3', () => this.toggleShown('contacts')],
      ['4', () => this.toggleShown('mesh')],
      [
        '5',
        () => {
          const all: Coloring[] = ['plain', 'stress', 'displacement'];
          this.setColor(all[(all.indexOf(this.view.shown.color) + 1) % 3] as Coloring);
        },
      ],
      ['\\', () => this.togglePanel()],
      ['?', () => this.help()],
    ]);
  }

  // --- files ----------------------------------------------------------------------------------------------------------

  private wireFiles(): void {
    const drop = element('drop');
    let depth = 0;
    const hasFiles = (e: DragEvent): boolean => e.dataTransfer?.types.includes('Files') ?? false;
    document.addEventListener('dragenter', (e) => {
      if (!hasFiles(e)) return;
      ++depth;
      drop.hidden = false;
    });
    document.addEventListener('dragleave', (e) => {
      if (!hasFiles(e)) return;
      depth = Math.max(0, depth - 1);
      if (depth === 0) drop.hidden = true;
    });
    document.addEventListener('dragover', (e) => e.preventDefault());
    document.addEventListener('drop', (e) => {
      e.preventDefault();
      depth = 0;
      drop.hidden = true;
      const file = e.dataTransfer?.files[0];
      if (file) void this.openFile(file);
    });
    const picker = input('file');
    button('open').addEventListener('click', () => picker.click());
    picker.addEventListener('change', () => {
      const file = picker.files?.[0];
      picker.value = '';
      if (file) void this.openFile(file);
    });
  }

  private async openFile(file: File): Promise<void> {
    if (/\.palpate$/i.test(file.name)) {
      this.openReplay(await file.arrayBuffer(), file.name, this.session.mode === 'view');
      return;
    }
    if (!/\.(obj|stl|ply|off|glb|gltf|3mf)$/i.test(file.name)) {
      this.notice('error', `${file.name} is none of OBJ, STL, PLY, OFF, glTF, 3MF and recording.palpate.`);
      return;
    }
    if (this.session.mode === 'replay') {
      this.notice('error', 'A surface can be held in a run: palpate view.');
      return;
    }
    if (file.size > this.session.maxSurfaceBytes) {
      this.notice('error', `${file.name} is larger than ${Math.floor(this.session.maxSurfaceBytes / 1048576)} MiB.`);
      return;
    }
    if (this.replay) this.leaveReplay();
    element('busy').hidden = false;
    setText(element('busy-text'), `Sending ${file.name}`);
    try {
      const response = await fetch(`surface?name=${encodeURIComponent(file.name)}&place=1`, {
        method: 'POST',
        headers: { 'content-type': 'application/octet-stream' },
        body: file,
      });
      if (response.status !== 202) {
        const answer: unknown = await response.json().catch(() => null);
        const reason = typeof answer === 'object' && answer !== null && 'error' in answer ? String(answer.error) : `the program answers ${response.status}`;
        this.notice('error', `${file.name}: ${reason}`);
      }
    } catch {
      this.notice('error', `${file.name} could not be sent.`);
    }
    element('busy').hidden = this.state?.busy == null;
  }

  // --- tests ----------------------------------------------------------------------------------------------------------

  /** Read-only view of the page's state, for tests and for the curious at the console. */
  private expose(): void {
    const app = this;
    const canvasPoint = (p: { x: number; y: number } | null): { x: number; y: number } | null => {
      const box = app.view.canvas.getBoundingClientRect();
      return p && { x: p.x + box.left, y: p.y + box.top };
    };
    const debug = {
      get frames() { return app.frames; },
      get pictures() { return app.view.pictures; },
      get ticks() { return app.history.received; },
      get lost() { return app.history.lost; },
      get lastForce() { return app.lastForce(); },
      get peakForce() {
        const out: [number, number] = [0, 0];
        app.history.ticks.extrema(TICKS.sentForce, app.history.ticks.first, app.history.ticks.length, out);
        return out[1];
      },
      get state() { return structuredClone(app.state); },
      get scene() { return structuredClone(app.scene); },
      get stats() { return structuredClone(app.stats); },
      get viewer() { return app.viewer; },
      get generation() { return app.generation; },
      get connected() { return app.link === 'open'; },
      get holding() { return app.hand.isHolding; },
      get delay() { return app.hand.delay; },
      get device() { return structuredClone(app.view.devicePose); },
      get software() { return app.view.software; },
      get firstPicture() { return app.firstPicture; },
      get replayTime() { return app.replay ? app.replay.time : null; },
      get cursor() { return app.panel.time.cursor; },
      get placement() { return app.placing.placement(); },
      get heldVertices() { return app.placing.heldVertices; },
      /** pixels of the page: a point of the tool's surface that faces the camera, and the handle */
      toolScreen: () => canvasPoint(app.view.frontOfTool()),
      handleScreen: () => canvasPoint(app.view.project(app.view.handleCenter)),
    }; // prettier-ignore
    Object.defineProperty(window, 'palpate', { value: Object.freeze(debug) });
  }
}

function fatal(error: unknown): void {
  const stage = document.getElementById('stage');
  const text = document.createElement('p');
  text.className = 'fatal';
  text.textContent = `The scene cannot be shown: ${error instanceof Error ? error.message : String(error)}`;
  stage?.append(text);
}

try {
  new App();
} catch (error) {
  fatal(error);
}
