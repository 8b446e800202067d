// Shapes of trame's client and of Vue's components, as far as the application uses them.

/** A connection by a web socket. */
export interface Session {
  call<T>(method: string, given: unknown[]): Promise<T>;
  subscribe<T>(topic: string, handler: (messages: [T]) => void): object;
  unsubscribe(subscription: object): Promise<unknown> | undefined;
}

/** Trame's client. */
export interface Trame {
  client: { getConnection(): { getSession(): Session } };
  connect(): Promise<unknown>;
}

/** A Vue component, with the instance that is `this` in its functions. */
export type Component<Instance> = ThisType<Instance & { trame: Trame }> & {
  props: Record<string, unknown>;
  inject: string[];
  template: string;
  computed?: Record<string, () => unknown>;
  watch?: Record<string, unknown>;
  methods: Record<string, (...given: never[]) => unknown>;
  mounted?(): unknown;
  beforeUnmount?(): void;
};

declare global {
  interface Window {
    trame: Trame;
    /** The properties that trame installs into the Vue application. */
    deformnb_app: { install(app: { component(name: string, component: Component<never>): void }): void };
  }
}
